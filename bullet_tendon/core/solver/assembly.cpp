// Residual and matrix of Newton's method at chain.next, by terms.
#include "solver/assembly.h"

#include <algorithm>
#include <limits>

#include "solver/body_schur.h"
#include "tendon/bending.h"

namespace bt {

namespace {

// Floor under a multiplier, as a share of the largest residual force [-]: the force up to which a
// spring is taken to be tight. 0: a slack tendon of a stiffening law transmits nothing, and a load
// travels one segment an iteration. Larger: slack tendons look stiff, and more iterations are needed.
constexpr double kFloorShare = 1e-2;

// Least weight of a free particle for a contact on a segment whose other end is held rigidly [-].
constexpr double kLeastLever = 0.25;

// A directly constrained particle that let go this often in a step stays free for its rest [-].
constexpr int kMostChanges = 4;

// Residual of one chain at chain.next: inertia, springs and soft holds. Returns the largest force.
double chain_residual(Chain& c) {
  const double inverse = 1 / (c.b * c.b);
  const double* mass = c.mass.data();
  for (int k = 0; k < 3; ++k) {
    const double *x = c.next[k], *y = c.goal[k], *tx = c.next_tail[k], *ty = c.goal_tail[k];
    double* r = c.residual[k];
    for (int i = 0; i < c.n(); ++i) r[i] = mass[i] * inverse * (x[i] - y[i] + (tx[i] - ty[i]));
  }
  double largest = c.residual.largest();
  for (SpringSet* s : {&c.structure, &c.shear}) {
    if (s->count == 0) continue;
    largest = std::max(largest, evaluate(*s, c.material.law, c.next, c.next_tail, c.anchor_x, c.b));
    scatter_forces(*s, c.residual);
  }
  add_bending_forces(c, c.next);
  add_soft_holds(c, c.next, false);
  for (const Hold& h : c.holds) largest = std::max(largest, h.rigid ? 0.0 : max_abs(h.force));
  return largest;
}

}  // namespace

// A row that constrains its particle directly: it starts to hold when the particle is inside, and
// lets go when it would have to pull (r is the force that the body supplies).
bool update_direct(Group& group, Row& row) {
  Chain& c = group.at(row.a);
  int i = row.a.w0 != 0 ? row.a.first : row.a.first + 1;
  if (row.held) {
    row.normal_force = std::max(0.0, dot(c.residual.at(i), row.normal));
    if (row.normal_force == 0) row.held = false, ++row.changes;
    return !row.held;
  }
  row.normal_force = 0;
  if (row.gap >= 0 || row.changes >= kMostChanges) return false;
  row.held = true;
  c.next.add(i, (-row.gap) * row.normal);
  return true;
}

// A row at chain.next, where its points follow what they touch.
void evaluate(Group& group, Row& row, bool at_position, bool definite) {
  if (group.follows && (row.kind == ContactKind::mouth || !definite)) follow(group, row);
  row.evaluate(relative_position(group, row, &Chain::next), at_position, definite);
}

// True residual of the group at chain.next; what holds supply is still in it.
Assembly residual_of(Group& group, bool at_position, bool definite) {
  Assembly a;
  clear_loads(group), clear_pulls(group);
  for (Chain* c : group.chains) a.scale = std::max(a.scale, chain_residual(*c));
  for (Row* row : group.rows) {
    evaluate(group, *row, at_position, definite);
    if (!row->acts()) continue;
    a.scale = std::max(a.scale, max_abs(row->total_force));
    add_row_force(group, *row);
  }
  for (Chain* c : group.chains) read_holds(*c);
  load_carried(group, &Chain::residual);
  start_body_residual(group, 1);
  return a;
}

void find_acting(Group& group) {
  group.acting.clear();
  for (Row* row : group.rows)
    if (row->acts()) group.acting.push_back(row);
}

void foresee_contacts(Group& group) {
  for (Row* row : group.rows) row->foresee(relative_position(group, *row, &Chain::step));
}

void carry_springs(Group& group) {
  for (Chain* c : group.chains)
    for (SpringSet* s : {&c->structure, &c->shear})
      if (s->count) carry(*s, c->material.law, c->step);
}

// The matrix, and the residual of the linearisation in place of the true one.
// definite_rows: the rows' blocks alone.
void assemble(Group& group, Linearisation how, bool definite, bool definite_rows) {
  clear_loads(group);
  for (Chain* c : group.chains) {
    const double inverse = 1 / (c->b * c->b), floor_force = kFloorShare * c->residual_norm;
    for (SpringSet* s : {&c->structure, &c->shear}) {
      if (s->count == 0) continue;
      linearise(*s, c->material.law, how, floor_force, c->b, definite);
      scatter_linearisation(*s, c->material.law, c->residual);
    }
    start_matrix(c->structure, c->shear, c->mass, inverse, c->matrix);
    add_bending_blocks(*c, c->next, definite);
    add_soft_holds(*c, c->next, true);
  }
  find_acting(group);
  for (Row* row : group.acting) {
    if (group.follows) add_lever_blocks(group, *row, definite_rows);
    add_row_block(group, *row);
    add_row_linearisation(group, *row);
  }
  load_carried(group, &Chain::residual);
  add_body_residual(group);
  make_border(group, definite);
  project_holds(group, &Chain::residual);
  hold_in_matrix(group);
}

namespace {

// The larger one; what is not a number stays.
double worse(double a, double b) { return b > a || b != b ? b : a; }

// Largest stiffness of springs at the present state [N/m]. Not the matrix's: that of a wild iteration would
// call any residual rounding.
double stiffness_at_hand(Chain& c) {
  double most = 0;
  for (SpringSet* s : {&c.structure, &c.shear})
    if (s->count) most = std::max(most, largest_stiffness(*s, c.material.law, c.b));
  return 2 * most;
}

// The same of what is evaluated at positions without their tails.
double stiffness_beside(const Chain& c) {
  double most = 0;
  for (const Hold& h : c.holds)
    if (!h.rigid) most = std::max({most, h.stiffness.xx, h.stiffness.yy, h.stiffness.zz, h.viscosity / c.b});
  if (c.material.bending_stiffness == 0) return 2 * most;
  const double rest = c.shortest_rest();
  return 2 * most + 16 * c.material.bending_stiffness / (rest * rest * rest);
}

// Force that one rounding makes: of a coordinate, or where positions have tails, of a segment's length [N].
double force_of_rounding(Chain& c, double contact, bool tails) {
  const double coordinate = c.next.largest();
  const double length = tails ? largest_of(c.structure.length.data(), c.structure.count) : coordinate;
  const double springs = stiffness_at_hand(c) * std::min(length, coordinate);
  return std::numeric_limits<double>::epsilon() * (springs + (stiffness_beside(c) + contact) * coordinate);
}

}  // namespace

// Residual norms, once what holds supply has been taken out.
void measure_residual(Group& group, Assembly& a) {
  project_holds(group, &Chain::residual);
  for (Chain* c : group.chains) {
    c->residual_norm = c->residual.largest();
    a.residual = worse(a.residual, c->residual_norm);
  }
  a.of_bodies = body_residual(group);
  a.residual = worse(a.residual, a.of_bodies);
}

double in_roundings(Group& group, const Assembly& a, bool tails) {
  double contact = 0, most = 0, finest = std::numeric_limits<double>::infinity();
  for (const Row* row : group.rows)
    if (row->normal_force > 0) contact = std::max(contact, row->stiffness);
  for (Chain* c : group.chains) {
    const double one = force_of_rounding(*c, contact, tails);
    most = worse(most, c->residual_norm / one);
    finest = std::min(finest, one);
  }
  return worse(most, a.of_bodies / finest);
}

void find_worst(Group& group) {
  for (Chain* c : group.chains) {
    for (int i = c->n() - 1; i >= 0; --i)
      if (!(max_abs(c->residual.at(i)) < c->residual_norm)) c->worst_particle = i;
  }
}

Vec3 relative_position(const Group& group, const Row& row, Field Chain::* where) {
  const Vec3 a = row.a.of(group.at(row.a).*where);
  if (row.b.chain >= 0) return a - row.b.of(group.at(row.b).*where);
  return row.moves && where != &Chain::x ? a - body_moved(group, row, where != &Chain::next) : a;
}

namespace {

void add_spot_force(Chain& c, const Spot& s, double sign, Vec3 force) {
  c.residual.add(s.first, (-sign * s.w0) * force);
  c.residual.add(s.first + 1, (-sign * s.w1) * force);
}

void add_spot_block(Chain& c, const Spot& s, const Sym3& block) {
  c.matrix.add(s.first, (s.w0 * s.w0) * block);
  c.matrix.add(s.first + 1, (s.w1 * s.w1) * block);
  c.matrix.add_below(s.first, 1, s.w0 * s.w1, block);
}

}  // namespace

void add_row_force(Group& group, const Row& row) {
  add_spot_force(group.at(row.a), row.a, 1, row.total_force);
  if (row.b.chain >= 0) add_spot_force(group.at(row.b), row.b, -1, row.total_force);
  if (row.moves) load_body(group, row, row.total_force);
}

void add_row_linearisation(Group& group, const Row& row) {
  const Vec3 more = row.linear_force - row.total_force;
  add_spot_force(group.at(row.a), row.a, 1, more);
  if (row.b.chain >= 0) add_spot_force(group.at(row.b), row.b, -1, more);
  if (row.moves) load_body(group, row, more);
}

void add_row_block(Group& group, const Row& row) {
  add_spot_block(group.at(row.a), row.a, row.block);
  if (row.b.chain >= 0) add_spot_block(group.at(row.b), row.b, row.block);
}

namespace {

void ends_of(const Group& group, const Row& row, Vec3 (&x)[4]) {
  const Field &a = group.at(row.a).next, &b = group.at(row.b).next;
  x[0] = a.at(row.a.first), x[1] = a.at(row.a.first + 1);
  x[2] = b.at(row.b.first), x[3] = b.at(row.b.first + 1);
}

void add_levers(Chain& c, int first, double share, Vec3 one, Vec3 other) {
  c.matrix.add(first, share * outer(one));
  c.matrix.add(first + 1, share * outer(other));
  c.matrix.add_below(first, share, other, one);
}

}  // namespace

void follow(Group& group, Row& row) {
  if (row.kind == ContactKind::mouth) {
    const Field& x = group.at(row.a).next;
    const Vec3 moved = row.moves ? body_moved(group, row, false) : Vec3{};
    row.follow(x.at(row.a.first) - moved, x.at(row.a.first + 1) - moved);
  } else if (row.b.chain >= 0) {
    Vec3 x[4];
    ends_of(group, row, x);
    const bool stayed = row.stays;
    row.follow_pair(x, group.most_jump);
    group.stayed |= row.stays && !stayed;
  }
}

void add_lever_blocks(Group& group, Row& row, bool definite) {
  Vec3 x[4];
  Chain& a = group.at(row.a);
  const int i = row.a.first;
  const Vec3 moved = row.moves ? body_moved(group, row, false) : Vec3{};
  if (row.kind == ContactKind::mouth)
    row.add_lever(a.next.at(i) - moved, a.next.at(i + 1) - moved, definite);
  else if (row.b.chain >= 0)
    ends_of(group, row, x), row.add_pair_levers(x, definite);
  for (int k = 0; k < row.levers; ++k) {
    const Vec3* l = row.lever[k];
    add_levers(a, i, row.lever_share[k], l[0], l[1]);
    if (row.b.chain >= 0) add_levers(group.at(row.b), row.b.first, row.lever_share[k], l[2], l[3]);
  }
}

void add_soft_holds(Chain& c, const Field& x, bool matrix) {
  for (Hold& h : c.holds) {
    if (h.rigid) continue;
    if (matrix) {
      c.matrix.add(h.particle, h.stiffness + identity(h.viscosity / c.b));
      continue;
    }
    Vec3 moved = x.at(h.particle) - c.anchor_x.at(h.particle);
    h.force = h.stiffness * (x.at(h.particle) - h.aim) + (h.viscosity / c.b) * moved;
    c.residual.add(h.particle, h.force);
  }
}

void project_holds(Group& group, Field Chain::* what) {
  for (Chain* c : group.chains)
    for (const Hold& h : c->holds)
      if (h.rigid) (c->*what).set(h.particle, Vec3{});
  for (const Row* row : group.rows) {
    if (!row->held) continue;
    Field& f = group.at(row->a).*what;
    int i = row->a.w0 != 0 ? row->a.first : row->a.first + 1;
    f.set(i, without(f.at(i), row->normal));
  }
}

void hold_in_matrix(Group& group) {
  for (Chain* c : group.chains)
    for (const Hold& h : c->holds)
      if (h.rigid) c->matrix.hold(h.particle, identity(1));
  for (const Row* row : group.rows)
    if (row->held)
      group.at(row->a).matrix.hold(row->a.w0 != 0 ? row->a.first : row->a.first + 1, outer(row->normal));
}

// That is a row whose particles are all held (or nearly so: what is free would have to move far for
// what is not), or one that a held end violates where it is taken. Where attachments are taken is for their
// bodies, but near there.
bool overruled(const Row& row, const Chain& c) {
  if (row.b.chain >= 0) return false;
  bool any_free = false;
  for (int e : {0, 1}) {
    const double weight = e ? row.a.w1 : row.a.w0;
    if (weight == 0) continue;
    const Hold* hold = nullptr;
    for (const Hold& h : c.holds)
      if ((h.rigid || h.link >= 0) && h.particle == row.a.first + e) hold = &h;
    any_free |= !hold && weight >= kLeastLever;
    if (!hold) continue;
    Row at_hold = row;
    at_hold.evaluate(hold->aim, true);
    if (at_hold.gap < 0) return true;
  }
  return !any_free;
}

void read_holds(Chain& c) {
  // The holder supplies the residual, and feels its opposite.
  for (Hold& h : c.holds)
    if (h.rigid) h.force = -c.residual.at(h.particle);
}

}  // namespace bt
