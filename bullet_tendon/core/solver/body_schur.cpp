// Bodies as unknowns beside the tendons' particles.
//
// With x the particles and y the unknowns of the bodies (bodies/body_response.h), what is solved is
// stationary in both:
//
//   r_x = as ever (integrator/scheme.h), rows at x_a - (p + B y), attached particles at p + B y
//   r_y = y + sum B^T (residual force of attached particles + force of the tendons' rows on the body)
//
// Newton's matrix is that of the tendons, A, with a border C and a corner D of one row and column by unknown
// of the bodies, of which there are few. By the Schur complement, with factors of A only,
//
//   (D - C^T A^-1 C) dy = -(r_y - C^T A^-1 r_x),     dx = -A^-1 (r_x + C dy).
//
// Both are made, and solved for, in solver/body_schur.cpp.
#include "solver/body_schur.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "solver/linear_solve.h"

namespace bt {

namespace {

Twist scaled(double s, const Twist& t) { return {s * t.linear, s * t.angular}; }

// s of bodies/body_response.h, of the part that is being solved for.
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

namespace {

// The border and the corner of Newton's matrix (solver/body_schur.cpp), eight unknowns of bodies at once.
//
// An unknown moves the links of its body and the particles that these carry. What that makes of the forces on
// the tendons is its column of the border, and what it makes of the loads on the links, by B^T, its column of
// the corner.

// What a twist makes of the place at r from its centre.
BT_WITHIN inline void place_at(const Eight* twist, Vec3 r, Eight* u) {
  u[0] = twist[0] + (r.z * twist[4] - r.y * twist[5]);
  u[1] = twist[1] + (r.x * twist[5] - r.z * twist[3]);
  u[2] = twist[2] + (r.y * twist[3] - r.x * twist[4]);
}

BT_WITHIN inline void add_force(Eight* load, const Eight* f, Vec3 r) {
  for (int c = 0; c < 3; ++c) load[c] += f[c];
  load[3] += r.y * f[2] - r.z * f[1];
  load[4] += r.z * f[0] - r.x * f[2];
  load[5] += r.x * f[1] - r.y * f[0];
}

// to += w v
BT_WITHIN inline void add(Eight* to, double w, const Eight* v) {
  for (int c = 0; c < 3; ++c) to[c] += w * v[c];
}

BT_WITHIN inline void dot(Vec3 a, const Eight* v, Eight* out) { *out = a.x * v[0] + a.y * v[1] + a.z * v[2]; }

// to += s a, of one vector by lane
BT_WITHIN inline void add(Eight* to, const Eight* s, Vec3 a) {
  to[0] += *s * a.x, to[1] += *s * a.y, to[2] += *s * a.z;
}

BT_WITHIN inline void times(const Sym3& b, const Eight* v, Eight* out) {
  dot({b.xx, b.xy, b.xz}, v, out), dot({b.xy, b.yy, b.yz}, v, out + 1), dot({b.xz, b.yz, b.zz}, v, out + 2);
}

// Of the motions of carried particles, at a spot.
BT_WITHIN inline void moved(Panel& panel, const Spot& s, Eight* out) {
  for (int c = 0; c < 3; ++c)
    out[c] = s.w0 * panel.moves.at(s.first)[c] + s.w1 * panel.moves.at(s.first + 1)[c];
}

BT_WITHIN inline void pull_back(Panel& panel, const Spot& s, const Eight* pull) {
  add(panel.pulls.at(s.first), -s.w0, pull), add(panel.pulls.at(s.first + 1), -s.w1, pull);
}

// What the band makes of the motion of particle i: pulls at its neighbours and itself.
BT_WITHIN inline void move_particle(const Band& a, int i, Panel& panel) {
  constexpr int kFull[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
  const Eight* u = panel.moves.at(i);
  auto add_entry = [&](int j, int r, int c, double entry) BT_WITHIN { panel.pulls.at(j)[r] += entry * u[c]; };
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      add_entry(i, r, c, a.diagonal[kFull[3 * r + c]][i]);
      for (int o = 1; o <= a.half; ++o) {
        if (i + o < a.n) add_entry(i + o, r, c, a.below[o - 1][3 * r + c][i]);
        if (i >= o) add_entry(i - o, r, c, a.below[o - 1][3 * c + r][i - o]);
      }
    }
}

// A row against a body: beside the block that it has in the tendon's own matrix.
BT_WITHIN inline void couple(const Row& row, Vec3 arm, const Border& border, Panel& panel,
                             LinkColumns& link) {
  Eight u[3], pull[3], back[3];
  place_at(link.twist, arm, u);
  times(row.block, u, pull);
  pull_back(panel, row.a, pull);
  if (border.carried) {
    moved(panel, row.a, u), times(row.block, u, back);
    add(pull, -1, back);
  }
  add_force(link.load, pull, arm);
}

// The same of the levers of a mouth's row: its edge moves as the ends of the segment do, the other way.
BT_WITHIN inline void couple_levers(const Row& row, Vec3 arm, Panel& panel, LinkColumns& link) {
  Eight u[3], along, at_end;
  place_at(link.twist, arm, u);
  for (int k = 0; k < row.levers; ++k) {
    const Vec3 ends[2] = {row.lever[k][0], row.lever[k][1]}, edge = -(ends[0] + ends[1]);
    dot(row.lever_share[k] * edge, u, &along);
    Eight sum = along;
    for (int e : {0, 1}) {
      add(panel.pulls.at(row.a.first + e), &along, ends[e]);
      dot(row.lever_share[k] * ends[e], panel.moves.at(row.a.first + e), &at_end);
      sum += at_end;
    }
    Eight force[3] = {};
    add(force, &sum, edge);
    add_force(link.load, force, arm);
  }
}

// A row between tendons, of which it has what is beside their bands.
BT_WITHIN inline void couple_pair(const Row& row, Panel& a, Panel& b) {
  Eight u[3], pull[3];
  moved(b, row.b, u), times(row.block, u, pull), pull_back(a, row.a, pull);
  moved(a, row.a, u), times(row.block, u, pull), pull_back(b, row.b, pull);
}

template <class Do>
BT_WITHIN inline void each_carried_column(Group& group, Do what) {
  for (size_t k = 0; k < group.chains.size(); ++k)
    for (const Hold& h : group.chains[k]->holds)
      if (h.moves) {
        const Link& link = (*group.links)[h.link];
        what(*group.chains[k], group.borders[k], h, link.now(link.arm_of(h.local)));
      }
}

// Where in the group a tendon is.
Border& border_of(Group& group, const Spot& s) { return group.borders[group.place_of[s.chain]]; }

void mark(Border& border, const Chain& c, int first, int last) {
  first = std::max(0, first), last = std::min(c.n() - 1, last);
  for (int i = first; i <= last; ++i) border.marks[i] = 1;
  border.first = std::min(border.first, first), border.last = std::max(border.last, last);
}

void mark(Group& group, const Spot& s) { mark(border_of(group, s), group.at(s), s.first, s.first + 1); }

void list_marks(Border& border) {
  border.pulled.clear();
  for (int i = border.first; i <= border.last; ++i)
    if (border.marks[i]) border.pulled.push_back(i);
}

// Which particles of every tendon the unknowns of bodies pull at.
void find_spans(Group& group) {
  group.borders.resize(group.chains.size());
  group.place_of.resize(group.slots->size());
  for (size_t k = 0; k < group.chains.size(); ++k) {
    group.place_of[group.numbers[k]] = static_cast<int>(k);
    Border& border = group.borders[k];
    const int n = group.chains[k]->n();
    border.marks.assign(n, 0), border.carried = false;
    border.first = n, border.last = -1;
  }
  each_carried_column(group, [](Chain& c, Border& border, const Hold& h, Vec3) {
    border.carried = true;
    mark(border, c, h.particle - c.matrix.half, h.particle + c.matrix.half);
  });
  for (const Row* row : group.acting) {
    if (row->moves) mark(group, row->a);
    if (row->b.chain < 0) continue;
    if (border_of(group, row->b).carried) mark(group, row->a);
    if (border_of(group, row->a).carried) mark(group, row->b);
  }
  for (Border& border : group.borders) list_marks(border);
}

void start_panel(Panel& panel, int n, const Border& border) {
  for (Columns* c : {&panel.pulls, &panel.answers, &panel.moves})
    if (!c->fits(n)) c->resize(n), panel.pulled.clear();
  for (int i : panel.pulled) panel.pulls.zero(i, i);
  for (size_t k = 0; panel.moved && k < panel.pulled.size(); ++k)
    panel.moves.zero(panel.pulled[k], panel.pulled[k]);
  panel.pulled = border.pulled, panel.moved = border.carried;
}

// Unknowns of the group from `column` on: what they make of the places of links.
void move_links(Group& group, int column) {
  group.of_links.resize(group.links->size());
  for (int l : group.carried) {
    const Link& link = (*group.links)[l];
    const Mover& m = (*group.movers)[link.mover];
    LinkColumns& of = group.of_links[l];
    of = {};
    for (int k = 0; k < m.freedom; ++k) {
      const int lane = m.first + k - column;
      if (lane < 0 || lane >= kLanes) continue;
      of.moves = true;
      for (int r = 0; r < 6; ++r) of.twist[r][lane] = group.reach * link.reached[r * m.freedom + k];
    }
  }
}

BT_VECTOR void move_carried(Group& group, size_t p) {
  each_carried_column(group, [&](Chain& c, Border& border, const Hold& h, Vec3 arm) BT_WITHIN {
    Panel& panel = border.panels[p];
    place_at(group.of_links[h.link].twist, arm, panel.moves.at(h.particle));
    move_particle(c.matrix, h.particle, panel);
  });
}

BT_VECTOR void couple_rows(Group& group, size_t p) {
  for (const Row* row : group.acting) {
    Border& a = border_of(group, row->a);
    if (row->b.chain >= 0) {
      Border& b = border_of(group, row->b);
      if (a.carried || b.carried) couple_pair(*row, a.panels[p], b.panels[p]);
    }
    if (!row->moves) continue;
    LinkColumns& link = group.of_links[row->link];
    if (!link.moves && !a.carried) continue;
    const Vec3 arm = (*group.links)[row->link].now(row->arm);
    couple(*row, arm, a, a.panels[p], link);
    if (row->kind == ContactKind::mouth) couple_levers(*row, arm, a.panels[p], link);
  }
  each_carried_column(group, [&](Chain&, Border& border, const Hold& h, Vec3 arm) BT_WITHIN {
    add_force(group.of_links[h.link].load, border.panels[p].pulls.at(h.particle), arm);
  });
}

// Loads on links by the unknowns from `column` on, on their own unknowns.
BT_VECTOR void fill_corner(Group& group, int column) {
  const int n = group.freedom, count = std::min(kLanes, n - column);
  for (int l : group.carried) {
    const Link& link = (*group.links)[l];
    const Mover& m = (*group.movers)[link.mover];
    for (int i = 0; i < m.freedom; ++i) {
      Eight sum{};
      for (int r = 0; r < 6; ++r)
        sum += (group.reach * link.reached[r * m.freedom + i]) * group.of_links[l].load[r];
      double* to = &group.corner[static_cast<size_t>(m.first + i) * n + column];
      for (int j = 0; j < count; ++j) to[j] += sum[j];
    }
  }
}

// What the pulls at bodies that turn far make of their torques, as they turn; definite: without what would
// swing them farther.
void stiffen_turned(Group& group, bool definite) {
  const int n = group.freedom;
  for (int l : group.carried) {
    const Link& link = (*group.links)[l];
    if (!link.turned.far) continue;
    const Mover& m = (*group.movers)[link.mover];
    const double reach = group.reach;
    const Sym3 k =
        (reach * reach) * (definite ? positive_part(link.turned.stiffness()) : link.turned.stiffness());
    auto spin = [&](int i) {
      return Vec3{link.root[3 * m.freedom + i], link.root[4 * m.freedom + i], link.root[5 * m.freedom + i]};
    };
    for (int i = 0; i < m.freedom; ++i)
      for (int j = 0; j < m.freedom; ++j)
        group.corner[static_cast<size_t>(m.first + i) * n + m.first + j] += dot(spin(i), k * spin(j));
  }
}

void project_holds(Group& group, size_t p) {
  for (size_t k = 0; k < group.chains.size(); ++k)
    for (const Hold& h : group.chains[k]->holds)
      if (h.rigid) group.borders[k].panels[p].pulls.zero(h.particle, h.particle);
  for (const Row* row : group.rows) {
    if (!row->held) continue;
    Eight* f = border_of(group, row->a).panels[p].pulls.at(row->a.w0 != 0 ? row->a.first : row->a.first + 1);
    const Eight along = row->normal.x * f[0] + row->normal.y * f[1] + row->normal.z * f[2];
    f[0] -= along * row->normal.x, f[1] -= along * row->normal.y, f[2] -= along * row->normal.z;
  }
}

}  // namespace

void make_border(Group& group, bool definite) {
  if (group.bodies.empty()) return;
  const int n = group.freedom;
  group.corner.assign(static_cast<size_t>(n) * n, 0.0);
  for (int k = 0; k < n; ++k) group.corner[k * n + k] = 1;
  stiffen_turned(group, definite);
  find_spans(group);
  for (size_t p = 0; p * kLanes < static_cast<size_t>(n); ++p) {
    const int column = static_cast<int>(p) * kLanes;
    for (size_t k = 0; k < group.chains.size(); ++k) {
      if (group.borders[k].panels.size() <= p) group.borders[k].panels.resize(p + 1);
      start_panel(group.borders[k].panels[p], group.chains[k]->n(), group.borders[k]);
    }
    move_links(group, column);
    move_carried(group, p);
    couple_rows(group, p);
    fill_corner(group, column);
    project_holds(group, p);
  }
}

namespace {

// The Schur complement of the tendons (solver/body_schur.cpp), by the columns of solver/body_schur.cpp and
// their answers.

int first_of(size_t panel) { return static_cast<int>(panel) * kLanes; }

int count_of(const Group& group, size_t panel) { return std::min(kLanes, group.freedom - first_of(panel)); }

// C^T A^-1 C, of the columns of panel p, by the first rows of panel q.
template <int Rows>
BT_WITHIN inline void multiply_answers(const Group& group, size_t p, size_t q, Eight* out) {
  Eight sums[Rows] = {};
  for (const Border& border : group.borders)
    for (int i : border.pulled)
      for (int c = 0; c < 3; ++c) {
        const Eight pull = border.panels[q].pulls.at(i)[c], answer = border.panels[p].answers.at(i)[c];
        for (int a = 0; a < Rows; ++a) sums[a] += pull[a] * answer;
      }
  for (int a = 0; a < Rows; ++a) out[a] = sums[a];
}

BT_VECTOR void multiply_answers(const Group& group, size_t p, size_t q, int rows, Eight* sums) {
  rows <= 3   ? multiply_answers<3>(group, p, q, sums)
  : rows <= 6 ? multiply_answers<6>(group, p, q, sums)
              : multiply_answers<kLanes>(group, p, q, sums);
}

// C^T x, of panel p.
BT_VECTOR void multiply_steps(const Group& group, size_t p, Which x, Eight& sum) {
  for (size_t k = 0; k < group.borders.size(); ++k) {
    const Border& border = group.borders[k];
    for (int i : border.pulled)
      for (int c = 0; c < 3; ++c) sum += (group.chains[k]->*x)[c][i] * border.panels[p].pulls.at(i)[c];
  }
}

// Takes panel p's pulls, each by its share, from a tendon's column.
BT_VECTOR void take_pulls(const Border& border, size_t p, const Eight& shares, Field& from) {
  for (int i : border.pulled)
    for (int c = 0; c < 3; ++c) {
      const Eight all = shares * border.panels[p].pulls.at(i)[c];
      double sum = 0;
      for (int j = 0; j < kLanes; ++j) sum += all[j];
      from[c][i] -= sum;
    }
}

}  // namespace

void take_column(Group& group, size_t p, int lane) {
  for (size_t k = 0; k < group.chains.size(); ++k)
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < group.chains[k]->n(); ++i)
        group.chains[k]->column[c][i] = group.borders[k].panels[p].pulls.at(i)[c][lane];
}

void put_answer(Group& group, size_t p, int lane) {
  for (size_t k = 0; k < group.chains.size(); ++k)
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < group.chains[k]->n(); ++i)
        group.borders[k].panels[p].answers.at(i)[c][lane] = group.chains[k]->solved[c][i];
}

void take_complement(Group& group, size_t p, size_t q) {
  Eight sums[kLanes] = {};
  multiply_answers(group, p, q, count_of(group, q), sums);
  auto entry = [&](int i, int j) -> double& {
    return group.corner[static_cast<size_t>(i) * group.freedom + j];
  };
  for (int a = 0; a < count_of(group, q); ++a)
    for (int j = 0; j < count_of(group, p); ++j) {
      const int row = first_of(q) + a, column = first_of(p) + j;
      entry(row, column) -= sums[a][j];
      if (p != q) entry(column, row) = entry(row, column);
    }
}

void take_steps(Group& group, size_t p, Which x) {
  Eight sum{};
  multiply_steps(group, p, x, sum);
  for (int j = 0; j < count_of(group, p); ++j) group.corner_side[first_of(p) + j] -= sum[j];
}

void answer_bodies(Group& group, Which b) {
  if (b != &Chain::column) combine(group, 1, b, 0, &Chain::column);
  for (size_t p = 0; first_of(p) < group.freedom; ++p) {
    Eight shares{};
    for (int j = 0; j < count_of(group, p); ++j) shares[j] = group.corner_side[first_of(p) + j];
    for (size_t k = 0; k < group.chains.size(); ++k)
      take_pulls(group.borders[k], p, shares, group.chains[k]->column);
  }
}

}  // namespace bt
