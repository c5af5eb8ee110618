// Residual and matrix of Newton's method at chain.next, by terms.
#include "assembly.h"

#include <limits>

#include "chain_bending.h"
#include "constants.h"

namespace bt {

namespace {

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

}  // namespace bt
