// Removes the energy that a step of implicit Euler creates from the velocities at its end.
//
// With v_1 = (x_1 - x_0)/b and all forces at x_1, the energy changes in a step by the work of the external
// forces, and by
//
//   sum (U_1 - U_0 + F_1.(x_1 - x_0))  -  sum m |v_1 - v_0|^2 / 2
//
// over springs (energy U, force F_1) and contacts, which store no energy (U = 0). A spring in tension and
// bending have convex potentials, so their terms are negative. A spring in compression that turns creates
// energy, about |F| l (1 - cos angle). So does a contact that pushes around a corner or out of a depth.
// Usually the numerical dissipation of the method, the second sum, is larger. Where it is smaller, inelastic
// impulses between pairs of interacting points remove the created energy (passivity controller: Hannaford and
// Ryu 2002). The first impulses act along contact normals and springs, which conserves linear and angular
// momentum. The next ones act across them, which is needed where a compressed tendon turns about an anchor.
// Where the velocities have less energy than was created, it remains in the positions.
#include <algorithm>
#include <cmath>

#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// Sweeps of impulses in each of the two directions, along and across.
constexpr int kSweeps = 4;

// Two points that interact through a spring or a contact. b.tendon = -1: a contact with a link.
struct Pair {
  SegmentPoint a, b;
  Vec3 along;          // unit, from b to a
  Vec3 link_velocity;  // of the link at the contact [m/s]
  Contact* contact = nullptr;
};

Anchor* rigid_anchor(Tendon& c, int i) {
  for (Anchor& h : c.anchors)
    if (h.rigid && h.particle == i) return &h;
  return nullptr;
}

// The particles of a point, with their weights.
template <class Do>
void each_particle(const SegmentPoint& s, Do what) {
  if (s.tendon < 0) return;
  if (s.w0 != 0) what(s.first, s.w0);
  if (s.w1 != 0) what(s.first + 1, s.w1);
}

// Inverse mass of a point for an impulse [1/kg]; anchored particles contribute 0.
double inverse_mass(const Island& island, const SegmentPoint& s) {
  double sum = 0;
  each_particle(s, [&](int i, double w) {
    Tendon& c = island.at(s);
    if (!rigid_anchor(c, i)) sum += w * w / c.mass[i];
  });
  return sum;
}

// An impulse p [N s] on a rigidly anchored particle acts on its anchor.
void apply_impulse(const Island& island, const SegmentPoint& s, Vec3 p) {
  each_particle(s, [&](int i, double w) {
    Tendon& c = island.at(s);
    if (Anchor* h = rigid_anchor(c, i))
      h->force.total += (w / c.h_eff) * p;
    else
      c.v_new.add(i, (w / c.mass[i]) * p);
  });
}

bool is_on_body(const Island& island, const SegmentPoint& s) {
  bool any = false;
  each_particle(s, [&](int i, double) {
    const Anchor* h = rigid_anchor(island.at(s), i);
    any |= h && h->moves;
  });
  return any;
}

// Removes the energy of the relative velocity of a pair, along its direction or across it, but at most `left`
// [J]. `left` decreases by what is removed.
void dissipate(const Island& island, const Pair& pair, bool across, double& left) {
  if (!(left > 0)) return;
  const double inverse = inverse_mass(island, pair.a) + inverse_mass(island, pair.b);
  if (!(inverse > 0) || is_on_body(island, pair.a) || is_on_body(island, pair.b)) return;
  const Vec3 of_b = pair.b.tendon >= 0 ? pair.b.of(island.at(pair.b).v_new) : pair.link_velocity;
  const Vec3 relative = pair.a.of(island.at(pair.a).v_new) - of_b;
  const Vec3 n = across ? unit_or(relative, pair.along) : pair.along;
  const double speed = dot(relative, n), there = 0.5 * speed * speed / inverse;
  if (!(there > 0)) return;
  const double remains = left < there ? std::sqrt(1 - left / there) : 0;
  const Vec3 p = (-(1 - remains) * speed / inverse) * n;
  apply_impulse(island, pair.a, p);
  apply_impulse(island, pair.b, -p);
  if (pair.contact) pair.contact->force.total += (1 / island.at(pair.a).h_eff) * p;
  left -= std::min(left, there);
}

// All pairs of the island, contacts first.
template <class Do>
void each_pair(const Island& island, Do what) {
  for (Contact* contact : island.contacts) {
    if (!contact->acts()) continue;
    Pair pair{contact->a, contact->b, contact->geometry.normal, {}, contact};
    if (contact->b.tendon < 0) {
      const Link& link = island.bodies.link(contact->link);
      if (link.yields()) continue;
      const Tendon& c = island.at(contact->a);
      pair.link_velocity = (1 / c.h_eff) * link.carry(contact->a.of(c.x), c.h_eff);
    }
    what(pair);
  }
  for (size_t k = 0; k < island.tendons.size(); ++k)
    for (const SpringSet* s : {&island.tendons[k]->structure, &island.tendons[k]->shear})
      for (int i = 0; i < s->count; ++i)
        what(Pair{{island.numbers[k], i + s->reach, 1, 0},
                  {island.numbers[k], i, 1, 0},
                  {s->direction[0][i], s->direction[1][i], s->direction[2][i]}});
}

// Energy of a tendon at the end of the step, minus that at its start and minus the work of external forces
// and anchors [J].
double gained(Tendon& c, Vec3 gravity) {
  double before = bending_energy(c, c.x), after = bending_energy(c, c.x_new), work = 0;
  for (SpringSet* s : {&c.structure, &c.shear}) {
    if (s->count == 0) continue;
    after += stored_energy(*s, c.material.law);
    before += stored_energy(*s, c.material.law, c.x);
  }
  for (int i = 0; i < c.n(); ++i) {
    const Vec3 v0 = c.v.at(i), v1 = c.v_new.at(i);
    before += 0.5 * c.mass[i] * dot(v0, v0);
    after += 0.5 * c.mass[i] * dot(v1, v1);
    work += dot(c.mass[i] * gravity + c.force.at(i), c.displacement.at(i));
  }
  for (const Anchor& h : c.anchors) work -= dot(h.force.total, c.displacement.at(h.particle));
  return after - before - work;
}

// Displacement of the link at a contact in the step [m].
Vec3 link_displacement(const Island& island, const Contact& contact) {
  const Tendon& c = island.at(contact.a);
  const Link& link = island.bodies.link(contact.link);
  const Vec3 carried = link.carry(contact.a.of(c.x), c.h_eff);
  return contact.moves ? carried + link.displaced(contact.arm) : carried;
}

bool has_compression(const Tendon& c) {
  for (const SpringSet* s : {&c.structure, &c.shear})
    if (std::any_of(s->force.begin(), s->force.end(), [](double f) { return f < 0; })) return true;
  return false;
}

}  // namespace

void project_energy(Island& island, Vec3 gravity) {
  const bool any = std::any_of(island.tendons.begin(), island.tendons.end(),
                               [](const Tendon* c) { return has_compression(*c); });
  if (!any && island.contacts.empty()) return;
  double left = 0;
  for (Tendon* c : island.tendons) left += gained(*c, gravity);
  for (const Contact* contact : island.contacts)
    if (contact->acts() && contact->b.tendon < 0)
      left -= dot(contact->force.total, link_displacement(island, *contact));
  for (const bool across : {false, true})
    for (int sweep = 0; sweep < kSweeps && left > 0; ++sweep)
      each_pair(island, [&](const Pair& pair) { dissipate(island, pair, across, left); });
}

}  // namespace bt
