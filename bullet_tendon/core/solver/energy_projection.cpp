// Energy that a step of implicit Euler makes out of nothing is taken out of it again.
//
// With v_1 = (x_1 - x_0)/b and all forces taken at x_1, the energy of a step changes by the work of what acts
// from outside, and besides by
//
//   sum (U_1 - U_0 + F_1.(x_1 - x_0))  -  sum m |v_1 - v_0|^2 / 2
//
// over springs (U their energy, F_1 their force) and contacts, which store nothing (U = 0). A spring in
// tension has a convex potential and makes no energy so. One that pushes does, as it turns: about
// |F| l (1 - cos of the angle), and so does a contact that pushes around a corner, or out of a depth. It is
// of the order of what Euler's method loses by itself, however short the step, and mostly less. Where it is
// more, the difference is taken from the velocities by inelastic impulses between pairs of points that act on
// each other anyhow (the passivity controller of haptics: Hannaford and Ryu 2002): along the springs and
// contacts that made it, then along all, which keeps linear and angular momentum, and only then, as where a
// pushing tendon turns about a point that holds it, across them.
#include "solver/energy_projection.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "solver/body_schur.h"
#include "tendon/bending.h"

namespace bt {

namespace {

// Share of the energy at hand under which what a step made out of nothing is rounding [-], and sweeps of
// impulses, along springs and contacts and across them, by which it is taken back.
constexpr double kCreated = 1e-12;
constexpr int kDissipationSweeps = 4;

Anchor* rigid_anchor(Tendon& c, int i) {
  for (Anchor& h : c.anchors)
    if (h.rigid && h.particle == i) return &h;
  return nullptr;
}

// What a point is made of: the particles of a spot with a share in it.
template <class Do>
void each_particle(const SegmentPoint& s, Do what) {
  if (s.w0 != 0) what(s.first, s.w0);
  if (s.w1 != 0) what(s.first + 1, s.w1);
}

double lightness(const Island& island, const SegmentPoint& s) {
  if (s.tendon < 0) return 0;
  Tendon& c = island.at(s);
  double sum = 0;
  each_particle(s, [&](int i, double w) { sum += rigid_anchor(c, i) ? 0 : w * w / c.mass[i]; });
  return sum;
}

// The impulse p at a spot; what holds it feels it in its place.
void hit(Island& island, const SegmentPoint& s, Vec3 p) {
  if (s.tendon < 0) return;
  Tendon& c = island.at(s);
  each_particle(s, [&](int i, double w) {
    if (Anchor* h = rigid_anchor(c, i))
      h->force += (w / c.h_eff) * p;
    else
      c.dx.add(i, (w / c.mass[i]) * p);
  });
}

bool carried_by_body(const Island& island, const SegmentPoint& s) {
  bool any = false;
  if (s.tendon < 0) return false;
  Tendon& c = island.at(s);
  each_particle(s, [&](int i, double) {
    const Anchor* h = rigid_anchor(c, i);
    any |= h && h->moves;
  });
  return any;
}

Vec3 relative_velocity(const Island& island, const Push& push) {
  const Vec3 a = push.a.of(island.at(push.a).dx);
  return a - (push.b.tendon >= 0 ? push.b.of(island.at(push.b).dx) : push.of_link);
}

// Takes the energy of the pair's relative velocity along the unit vector n, and `left` at most.
void dissipate(Island& island, const Push& push, Vec3 n, double& left) {
  const double speed = dot(relative_velocity(island, push), n);
  const double there = 0.5 * speed * speed / push.light, taken = std::min(left, there);
  if (!(left > 0 && there > 0)) return;
  const double stays = taken < there ? std::sqrt(1 - taken / there) : 0;
  const Vec3 p = (-(1 - stays) * speed / push.light) * n;
  hit(island, push.a, p), hit(island, push.b, -p);
  if (push.contact) push.contact->total_force += (1 / island.at(push.a).h_eff) * p;
  left -= taken;
}

double spring_energy(const Tendon& c, const SpringSet& s, int k, double length) {
  return s.stiffness[k] * s.rest[k] * elastic_energy(c.material.law, length / s.rest[k] - 1);
}

// Most that the springs that push can have made by turning.
double created_by_rotation(const Tendon& c) {
  double sum = 0;
  for (const SpringSet* s : {&c.structure, &c.shear})
    for (int k = 0; k < s->count; ++k) {
      if (!(s->force[k] < 0)) continue;
      const Vec3 n{s->direction[0][k], s->direction[1][k], s->direction[2][k]};
      const Vec3 before = c.x.at(k + s->reach) - c.x.at(k);
      sum -= s->force[k] * (norm(before) - dot(n, before));
    }
  return sum;
}

// Made by springs, less what damping took; `most` grows by the energy that rounding is told from.
double created_by_springs(Island& island, size_t number, double& most) {
  Tendon& c = *island.tendons[number];
  double sum = 0;
  for (const SpringSet* s : {&c.structure, &c.shear})
    for (int k = 0; k < s->count; ++k) {
      const int j = k + s->reach;
      const Vec3 pull{s->vector[0][k], s->vector[1][k], s->vector[2][k]};
      const Vec3 before = c.x.at(j) - c.x.at(k), now = c.x_new.at(j) - c.x_new.at(k);
      const double stored = spring_energy(c, *s, k, s->length[k]);
      const double made = stored - spring_energy(c, *s, k, norm(before)) - dot(pull, now - before);
      const int tendon = island.numbers[number];
      island.pushes.push_back({{tendon, j, 1, 0}, {tendon, k, 1, 0}, unit_or(now, {0, 0, 1}), {}, made});
      sum += made, most += stored;
    }
  if (!bends(c)) return sum;
  const double stored = bending_energy(c, c.x_new);
  c.residual.zero();
  add_bending_forces(c, c.x_new);
  sum += stored - bending_energy(c, c.x) - inner(c.residual, c.x_new) + inner(c.residual, c.x);
  most += stored;
  return sum;
}

// Made by contacts, less what friction took.
double created_by_contact(Island& island, Contact& contact) {
  const Tendon& c = island.at(contact.a);
  Push push{contact.a, contact.b, contact.normal, {}, 0, &contact};
  Vec3 moved = contact.a.of(c.x_new) - contact.a.of(c.x);
  if (contact.b.tendon >= 0) {
    moved -= contact.b.of(island.at(contact.b).x_new) - contact.b.of(island.at(contact.b).x);
  } else {
    const Link& link = (*island.links)[contact.link];
    const Vec3 drift = link.drift(contact.a.of(c.x), c.h_eff);
    moved -= contact.moves ? drift + body_moved(island, contact, false) : drift;
    push.of_link = (1 / c.h_eff) * drift;
  }
  push.energy_created = dot(contact.total_force, moved);
  if (contact.link < 0 || !(*island.links)[contact.link].yields()) island.pushes.push_back(push);
  return push.energy_created;
}

// What Euler's method loses by itself; the velocities at the end go to `step`.
double lost(Tendon& c, double& kinetic) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    const double *x = c.x_new[k], *tail = c.x_new_tail[k], *xh = c.x_history[k], *v0 = c.v[k],
                 *mass = c.mass.data();
    double* v = c.dx[k];
    for (int i = 0; i < c.n(); ++i) {
      v[i] = (x[i] - xh[i] + tail[i]) / c.h_eff;
      sum += 0.5 * mass[i] * (v[i] - v0[i]) * (v[i] - v0[i]);
      kinetic += 0.5 * mass[i] * v[i] * v[i];
    }
  }
  return sum;
}

// The same of the bodies, by what the tendons changed their velocities.
double lost_by_bodies(const Island& island, double b) {
  const double reach = island.reach;
  double sum = 0;
  for (int m : island.bodies)
    sum += dense::dot((*island.all_bodies)[m].unknowns.y, (*island.all_bodies)[m].unknowns.y);
  for (const Tendon* c : island.tendons)
    for (const Anchor& h : c->anchors)
      if (h.link >= 0 && !h.rigid) sum += dot(h.force, c->x_new.at(h.particle) - h.aim);
  return sum > 0 ? 0.5 * sum * (b * b) / (reach * reach) : 0;
}

void dissipate_all(Island& island, double& left, bool makers, bool across) {
  for (Push& push : island.pushes) {
    if (!(left > 0)) return;
    if (makers && !(push.energy_created > 0)) continue;
    dissipate(island, push, across ? unit_or(relative_velocity(island, push), push.along) : push.along, left);
  }
}

// Leaves those that have no part in taking it back out.
void find_dissipating(Island& island) {
  auto is_none = [&](Push& push) {
    push.light = lightness(island, push.a) + lightness(island, push.b);
    return !(push.light > 0) || carried_by_body(island, push.a) || carried_by_body(island, push.b);
  };
  auto& all = island.pushes;
  all.erase(std::remove_if(all.begin(), all.end(), is_none), all.end());
}

}  // namespace

void project_energy(Island& island) {
  double made = 0, energy = 0;
  for (Tendon* c : island.tendons) c->braked = false;
  for (Tendon* c : island.tendons) made += bends(*c) ? 1e300 : created_by_rotation(*c);
  if (made <= 0 && island.contacts.empty()) return;
  island.pushes.clear();
  made = 0;
  for (size_t k = 0; k < island.tendons.size(); ++k) made += created_by_springs(island, k, energy);
  for (Contact* contact : island.contacts)
    if (contact->acts()) made += created_by_contact(island, *contact);
  for (Tendon* c : island.tendons) made -= lost(*c, energy);
  made -= lost_by_bodies(island, island.tendons[0]->h_eff);
  if (!(made > kCreated * energy)) return;
  double left = made;
  find_dissipating(island);
  dissipate_all(island, left, true, false);
  for (int sweep = 0; sweep < kDissipationSweeps; ++sweep) dissipate_all(island, left, false, false);
  for (int sweep = 0; sweep < kDissipationSweeps; ++sweep) dissipate_all(island, left, false, true);
  for (Tendon* c : island.tendons) c->braked = true;
}

}  // namespace bt
