// Bodies as unknowns beside the tendons' particles.
//
// With x the particles and y the unknowns of the bodies (mover.h), what is solved is stationary in both:
//
//   r_x = as ever (stepping.h), rows at x_a - (p + B y), attached particles at p + B y
//   r_y = y + sum B^T (residual force of attached particles + force of the tendons' rows on the body)
//
// Newton's matrix is that of the tendons, A, with a border C and a corner D of one row and column by unknown
// of the bodies, of which there are few. By the Schur complement, with factors of A only,
//
//   (D - C^T A^-1 C) dy = -(r_y - C^T A^-1 r_x),     dx = -A^-1 (r_x + C dy).
//
// Both are made, and solved for, in columns.cpp.
#include <algorithm>
#include <limits>

#include "stepping.h"

namespace bt {

namespace {

Twist scaled(double s, const Twist& t) { return {s * t.linear, s * t.angular}; }

// s of mover.h, of the part that is being solved for.
double reach_of(const Group& group) { return group.reach; }

template <class Do>
void each_body(const Group& group, Do what) {
  for (int m : group.bodies) what((*group.movers)[m]);
}

template <class Do>
void each_carried(Group& group, Do what) {
  for (Chain* c : group.chains)
    for (const Hold& h : c->holds)
      if (h.moves) {
        Link& link = (*group.links)[h.link];
        what(*c, h, link, link.arm_of(h.local));
      }
}

void add_load(Link& link, Vec3 force, Vec3 arm) {
  const Vec3 now = link.now(arm);
  link.load.linear += force, link.load.angular += cross(now, force);
  if (link.turned.far) link.turned.add_pull(now, force);
}

// B^T of the loads on links, added to the numbers of their movers.
template <class Numbers>
void add_generalized_loads(const Group& group, Numbers numbers_of) {
  for (int l : group.carried) {
    const Link& link = (*group.links)[l];
    link.add_generalized(link.reached, scaled(reach_of(group), link.load), numbers_of(link.mover));
  }
}

// What the bodies' steps make of the particles that they carry.
void carry_steps(Group& group, Which steps) {
  each_carried(group, [&](Chain& c, const Hold& h, Link& link, Vec3 arm) {
    (c.*steps).set(h.particle, link.stepped.at(link.now(arm)));
  });
}

void place(Group& group) {
  for (int l : group.carried) {
    Link& link = (*group.links)[l];
    const Mover& m = (*group.movers)[link.mover];
    link.given = scaled(reach_of(group), link.spin_of(m.y));
    if (link.turned.far) link.turn(m, 1);
  }
  each_carried(group, [](Chain& c, const Hold& h, Link& link, Vec3 arm) {
    c.next.set(h.particle, h.aim), c.next_tail.set(h.particle, Vec3{});
    c.move(h.particle, link.displaced(arm));
  });
}

// The last step's forces are the first guess at this one's.
void guess(const Group& group, Mover& m) {
  m.y.assign(m.freedom, 0.0), m.step.assign(m.freedom, 0.0), m.residual.assign(m.freedom, 0.0);
  if (static_cast<int>(m.observer.forces().size()) != m.n()) return;
  dense::Numbers all;
  dense::multiply_transposed(m.root, m.observer.forces(), all);
  if (m.freedom == m.n())
    m.y = all;
  else
    dense::multiply(m.basis, all, m.y);
  for (double& v : m.y) v *= reach_of(group);
}

// A guess that moves the body by more than a segment could turn the segment over.
void shorten(Mover& m, double most) {
  const double moved = m.lever * std::sqrt(dense::dot(m.y, m.y));
  if (moved > most)
    for (double& v : m.y) v *= most / moved;
}

}  // namespace

void start_bodies(Group& group) {
  if (group.bodies.empty()) return;
  each_body(group, [&](Mover& m) { guess(group, m), m.lever = 0; });
  auto reach_to = [&](Link& link, Vec3 arm) {
    double& lever = (*group.movers)[link.mover].lever;
    lever = std::max(lever, reach_of(group) * std::sqrt(trace(link.mobility(link.centre + arm))));
  };
  each_carried(group, [&](Chain&, const Hold&, Link& link, Vec3 arm) { reach_to(link, arm); });
  for (const Row* row : group.rows)
    if (row->moves) reach_to((*group.links)[row->link], row->arm);
  double shortest = std::numeric_limits<double>::infinity();
  for (const Chain* c : group.chains) shortest = std::min(shortest, c->shortest_rest());
  each_body(group, [&](Mover& m) { shorten(m, shortest); });
  place(group);
}

void forget_bodies(Group& group) {
  if (group.bodies.empty()) return;
  each_body(group, [](Mover& m) { m.y.assign(m.freedom, 0.0); });
  place(group);
}

void advance_bodies(Group& group, double alpha) {
  if (group.bodies.empty()) return;
  each_body(group, [&](Mover& m) {
    for (int k = 0; k < m.freedom; ++k) m.y[k] += alpha * m.step[k];
  });
  place(group);
}

void move_bodies(Group& group, double share, Which x) {
  if (group.bodies.empty()) return;
  each_body(group, [&](Mover& m) {
    for (int k = 0; k < m.freedom; ++k) m.step[k] = share * group.corner_side[m.first + k];
  });
  for (int l : group.carried) {
    Link& link = (*group.links)[l];
    link.stepped = scaled(reach_of(group), link.twist_of((*group.movers)[link.mover].step));
  }
  carry_steps(group, x);
}

Vec3 torque_of(const Group& group, const Hold& h, Vec3 force) {
  const Link& link = (*group.links)[h.link];
  return link.torque_of(force, link.arm_of(h.local));
}

Vec3 body_moved(const Group& group, const Row& row, bool by_step) {
  const Link& link = (*group.links)[row.link];
  return by_step ? link.stepped.at(link.now(row.arm)) : link.displaced(row.arm);
}

void clear_loads(Group& group) {
  for (int l : group.carried) (*group.links)[l].load = {};
}

void clear_pulls(Group& group) {
  for (int l : group.carried) (*group.links)[l].turned.pulls = {{}, {}, {}};
}

void load_body(Group& group, const Row& row, Vec3 force) {
  add_load((*group.links)[row.link], force, row.arm);
}

void load_carried(Group& group, Which forces) {
  each_carried(group, [&](Chain& c, const Hold& h, Link& link, Vec3 arm) {
    add_load(link, (c.*forces).at(h.particle), arm);
  });
}

void start_body_residual(Group& group, double share) {
  each_body(group, [share](Mover& m) {
    for (int k = 0; k < m.freedom; ++k) m.residual[k] = share * m.y[k];
  });
  add_body_residual(group);
}

void add_body_residual(Group& group) {
  add_generalized_loads(group, [&](int m) -> dense::Numbers& { return (*group.movers)[m].residual; });
}

double body_residual(const Group& group) {
  double most = 0;
  each_body(group, [&](const Mover& m) {
    const double size = std::sqrt(dense::dot(m.residual, m.residual));
    const double force = m.lever > 0 ? size / m.lever : 0 * size;
    if (!(force <= most)) most = force;
  });
  return most;
}

double body_slope(const Group& group) {
  double sum = 0;
  each_body(group, [&](const Mover& m) { sum += dense::dot(m.residual, m.step); });
  return sum;
}

}  // namespace bt
