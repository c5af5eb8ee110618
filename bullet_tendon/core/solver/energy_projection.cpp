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
constexpr int kBrakes = 4;

Hold* rigid_hold(Chain& c, int i) {
  for (Hold& h : c.holds)
    if (h.rigid && h.particle == i) return &h;
  return nullptr;
}

// What a point is made of: the particles of a spot with a share in it.
template <class Do>
void each_particle(const Spot& s, Do what) {
  if (s.w0 != 0) what(s.first, s.w0);
  if (s.w1 != 0) what(s.first + 1, s.w1);
}

double lightness(const Group& group, const Spot& s) {
  if (s.chain < 0) return 0;
  Chain& c = group.at(s);
  double sum = 0;
  each_particle(s, [&](int i, double w) { sum += rigid_hold(c, i) ? 0 : w * w / c.mass[i]; });
  return sum;
}

// The impulse p at a spot; what holds it feels it in its place.
void hit(Group& group, const Spot& s, Vec3 p) {
  if (s.chain < 0) return;
  Chain& c = group.at(s);
  each_particle(s, [&](int i, double w) {
    if (Hold* h = rigid_hold(c, i))
      h->force += (w / c.b) * p;
    else
      c.step.add(i, (w / c.mass[i]) * p);
  });
}

bool carried_by_body(const Group& group, const Spot& s) {
  bool any = false;
  if (s.chain < 0) return false;
  Chain& c = group.at(s);
  each_particle(s, [&](int i, double) {
    const Hold* h = rigid_hold(c, i);
    any |= h && h->moves;
  });
  return any;
}

Vec3 relative_velocity(const Group& group, const Push& push) {
  const Vec3 a = push.a.of(group.at(push.a).step);
  return a - (push.b.chain >= 0 ? push.b.of(group.at(push.b).step) : push.of_link);
}

// Takes the energy of the pair's relative velocity along the unit vector n, and `left` at most.
void brake(Group& group, const Push& push, Vec3 n, double& left) {
  const double speed = dot(relative_velocity(group, push), n);
  const double there = 0.5 * speed * speed / push.light, taken = std::min(left, there);
  if (!(left > 0 && there > 0)) return;
  const double stays = taken < there ? std::sqrt(1 - taken / there) : 0;
  const Vec3 p = (-(1 - stays) * speed / push.light) * n;
  hit(group, push.a, p), hit(group, push.b, -p);
  if (push.row) push.row->total_force += (1 / group.at(push.a).b) * p;
  left -= taken;
}

double spring_energy(const Chain& c, const SpringSet& s, int k, double length) {
  return s.stiffness[k] * s.rest[k] * elastic_energy(c.material.law, length / s.rest[k] - 1);
}

// Most that the springs that push can have made by turning.
double made_by_turning(const Chain& c) {
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
double made_by_springs(Group& group, size_t number, double& most) {
  Chain& c = *group.chains[number];
  double sum = 0;
  for (const SpringSet* s : {&c.structure, &c.shear})
    for (int k = 0; k < s->count; ++k) {
      const int j = k + s->reach;
      const Vec3 pull{s->vector[0][k], s->vector[1][k], s->vector[2][k]};
      const Vec3 before = c.x.at(j) - c.x.at(k), now = c.next.at(j) - c.next.at(k);
      const double stored = spring_energy(c, *s, k, s->length[k]);
      const double made = stored - spring_energy(c, *s, k, norm(before)) - dot(pull, now - before);
      const int chain = group.numbers[number];
      group.pushes.push_back({{chain, j, 1, 0}, {chain, k, 1, 0}, unit_or(now, {0, 0, 1}), {}, made});
      sum += made, most += stored;
    }
  if (!bends(c)) return sum;
  const double stored = bending_energy(c, c.next);
  c.residual.zero();
  add_bending_forces(c, c.next);
  sum += stored - bending_energy(c, c.x) - inner(c.residual, c.next) + inner(c.residual, c.x);
  most += stored;
  return sum;
}

// Made by contacts, less what friction took.
double made_by_row(Group& group, Row& row) {
  const Chain& c = group.at(row.a);
  Push push{row.a, row.b, row.normal, {}, 0, &row};
  Vec3 moved = row.a.of(c.next) - row.a.of(c.x);
  if (row.b.chain >= 0) {
    moved -= row.b.of(group.at(row.b).next) - row.b.of(group.at(row.b).x);
  } else {
    const Link& link = (*group.links)[row.link];
    const Vec3 drift = link.drift(row.a.of(c.x), c.b);
    moved -= row.moves ? drift + body_moved(group, row, false) : drift;
    push.of_link = (1 / c.b) * drift;
  }
  push.made = dot(row.total_force, moved);
  if (row.link < 0 || !(*group.links)[row.link].yields()) group.pushes.push_back(push);
  return push.made;
}

// What Euler's method loses by itself; the velocities at the end go to `step`.
double lost(Chain& c, double& kinetic) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    const double *x = c.next[k], *tail = c.next_tail[k], *xh = c.anchor_x[k], *v0 = c.v[k],
                 *mass = c.mass.data();
    double* v = c.step[k];
    for (int i = 0; i < c.n(); ++i) {
      v[i] = (x[i] - xh[i] + tail[i]) / c.b;
      sum += 0.5 * mass[i] * (v[i] - v0[i]) * (v[i] - v0[i]);
      kinetic += 0.5 * mass[i] * v[i] * v[i];
    }
  }
  return sum;
}

// The same of the bodies, by what the tendons changed their velocities.
double lost_by_bodies(const Group& group, double b) {
  const double reach = group.reach;
  double sum = 0;
  for (int m : group.bodies) sum += dense::dot((*group.movers)[m].y, (*group.movers)[m].y);
  for (const Chain* c : group.chains)
    for (const Hold& h : c->holds)
      if (h.link >= 0 && !h.rigid) sum += dot(h.force, c->next.at(h.particle) - h.aim);
  return sum > 0 ? 0.5 * sum * (b * b) / (reach * reach) : 0;
}

void brake_all(Group& group, double& left, bool makers, bool across) {
  for (Push& push : group.pushes) {
    if (!(left > 0)) return;
    if (makers && !(push.made > 0)) continue;
    brake(group, push, across ? unit_or(relative_velocity(group, push), push.along) : push.along, left);
  }
}

// Leaves those that have no part in taking it back out.
void find_brakes(Group& group) {
  auto is_none = [&](Push& push) {
    push.light = lightness(group, push.a) + lightness(group, push.b);
    return !(push.light > 0) || carried_by_body(group, push.a) || carried_by_body(group, push.b);
  };
  auto& all = group.pushes;
  all.erase(std::remove_if(all.begin(), all.end(), is_none), all.end());
}

}  // namespace

void keep_passive(Group& group) {
  double made = 0, energy = 0;
  for (Chain* c : group.chains) c->braked = false;
  for (Chain* c : group.chains) made += bends(*c) ? 1e300 : made_by_turning(*c);
  if (made <= 0 && group.rows.empty()) return;
  group.pushes.clear();
  made = 0;
  for (size_t k = 0; k < group.chains.size(); ++k) made += made_by_springs(group, k, energy);
  for (Row* row : group.rows)
    if (row->acts()) made += made_by_row(group, *row);
  for (Chain* c : group.chains) made -= lost(*c, energy);
  made -= lost_by_bodies(group, group.chains[0]->b);
  if (!(made > kCreated * energy)) return;
  double left = made;
  find_brakes(group);
  brake_all(group, left, true, false);
  for (int sweep = 0; sweep < kBrakes; ++sweep) brake_all(group, left, false, false);
  for (int sweep = 0; sweep < kBrakes; ++sweep) brake_all(group, left, false, true);
  for (Chain* c : group.chains) c->braked = true;
}

}  // namespace bt
