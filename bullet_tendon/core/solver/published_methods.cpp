// The paper's own steppers: explicit Euler (6) and one linearisation of implicit Euler (8), (9).
#include "solver/published_methods.h"

#include <algorithm>
#include <utility>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/linear_solve.h"
#include "tendon/bending.h"

namespace bt {

namespace {

// chain.residual = minus all forces but those of holds and contacts, at (x, v), with damping forces
// times `damping_share`; matrix: their blocks.
void forces_now(Chain& c, const StepContext& context, bool matrix, double damping_share) {
  if (matrix) c.matrix.zero();
  for (int k = 0; k < 3; ++k) {
    const double g = k == 0 ? context.gravity.x : k == 1 ? context.gravity.y : context.gravity.z;
    for (int i = 0; i < c.n(); ++i) c.residual[k][i] = -(c.mass[i] * g + c.force[k][i]);
  }
  for (SpringSet* s : {&c.structure, &c.shear}) {
    if (s->count == 0) continue;
    evaluate_at(*s, c.material.law, c.x, c.v, context.dt, damping_share);
    scatter_forces(*s, c.residual);
    if (matrix) scatter_blocks(*s, c.matrix);
  }
  add_bending_forces(c, c.x);
  if (matrix) add_bending_blocks(c, c.x, true);
}

void rows_now(Group& group, bool matrix) {
  for (Row* row : group.rows) {
    row->direct = false;
    const Vec3 relative = relative_position(group, *row, &Chain::x);
    row->limit = 0;
    row->evaluate(relative, true);  // for the normal force, which limits friction
    row->limit = row->friction * row->normal_force;
    row->evaluate(relative, true);
    if (row->normal_force <= 0) continue;
    add_row_force(group, *row);
    if (matrix) add_row_block(group, *row);
  }
  find_acting(group);
}

Vec3 held_velocity(const Chain& c, const Hold& h, double dt) {
  return (1 / dt) * (h.aim - c.x.at(h.particle));
}

void add_stiff_holds_and_inertia(Chain& c, double dt) {
  for (const Hold& h : c.holds) {
    if (h.rigid) continue;
    c.residual.add(h.particle, h.stiffness * (c.x.at(h.particle) - h.aim));
    c.matrix.add(h.particle, h.stiffness + identity(h.viscosity / dt));
  }
  for (int i = 0; i < c.n(); ++i) {
    c.residual.add(i, (-c.mass[i] / dt) * c.v.at(i));
    for (int plane : {0, 3, 5}) c.matrix.diagonal[plane][i] += c.mass[i] / (dt * dt);
  }
}

// The force of a row after the displacements, by its own linearisation: what the solution used.
void predict(Group& group, Row& row) {
  if (row.normal_force <= 0) return;
  row.total_force -= row.block * relative_position(group, row, &Chain::step);
  row.normal_force = dot(row.total_force, row.normal);
  row.tangent_force = without(row.total_force, row.normal);
}

void settle_rows(Group& group) {
  for (Row* row : group.rows) row->settle(relative_position(group, *row, &Chain::next));
}

Vec3 spring_forces_after(const Chain& c, int i) {
  Vec3 sum;
  for (const SpringSet* s : {&c.structure, &c.shear})
    for (int end : {0, 1}) {
      int k = end ? i - s->reach : i, other = end ? k : i + s->reach;
      if (k < 0 || k >= s->count) continue;
      Sym3 b{s->block[0][k], s->block[1][k], s->block[2][k], s->block[3][k], s->block[4][k], s->block[5][k]};
      Vec3 f{s->vector[0][k], s->vector[1][k], s->vector[2][k]};
      sum += (end ? -1.0 : 1.0) * f + b * (c.step.at(other) - c.step.at(i));
    }
  return sum;
}

// On the holder, after the displacements: minus what the particle needs beyond its other forces.
Vec3 predicted_hold_force(const Group& group, const Chain& c, const Hold& h, const StepContext& context) {
  const int i = h.particle;
  const Vec3 u = c.step.at(i);
  if (!h.rigid) return h.stiffness * (c.x.at(i) + u - h.aim) + (h.viscosity / context.dt) * u;
  Vec3 needs = (c.mass[i] / (context.dt * context.dt)) * (u - context.dt * c.v.at(i));
  Vec3 has = c.mass[i] * context.gravity + c.force.at(i) + spring_forces_after(c, i) +
             bending_force_after(c, c.x, c.step, i);
  for (const Row* row : group.rows)
    for (const auto& [spot, sign] : {std::pair{row->a, 1.0}, std::pair{row->b, -1.0}}) {
      if (spot.chain < 0 || row->normal_force <= 0 || &group.at(spot) != &c) continue;
      if (i == spot.first) has += (sign * spot.w0) * row->total_force;
      if (i == spot.first + 1) has += (sign * spot.w1) * row->total_force;
    }
  return has - needs;
}

}  // namespace

// (6): (dx, dv) = dt (v_0, M^-1 f_0). chain.step carries the new velocities.
void explicit_euler(Group& group, const StepContext& context) {
  const double dt = context.dt;
  for (Chain* c : group.chains) forces_now(*c, context, false, 1);
  rows_now(group, false);
  for (Chain* c : group.chains) {
    c->b = dt;
    for (Hold& h : c->holds) {
      if (h.rigid) continue;
      h.force = h.stiffness * (c->x.at(h.particle) - h.aim) + h.viscosity * c->v.at(h.particle);
      c->residual.add(h.particle, h.force);
    }
    for (int i = 0; i < c->n(); ++i) {
      c->next.set(i, c->x.at(i) + dt * c->v.at(i));
      c->step.set(i, c->v.at(i) - (dt / c->mass[i]) * c->residual.at(i));
    }
    for (Hold& h : c->holds) {
      if (!h.rigid) continue;
      Vec3 v = held_velocity(*c, h, dt), before = c->v.at(h.particle);
      h.force = -((c->mass[h.particle] / dt) * (v - before) + c->residual.at(h.particle));
      c->next.set(h.particle, h.aim), c->step.set(h.particle, v);
    }
  }
  settle_rows(group);
  group.converged = true;
}

// (9): (M - dt df/dv - dt^2 df/dx) dv = dt (f_0 + dt df/dx v_0), solved for the displacements
// u = dt (v_0 + dv). Divided by dt^2 it reads
//
//   A u = M v_0/dt + f_0 - (df/dv) v_0,     A = M/dt^2 - df/dx - (df/dv)/dt,
//
// where A is the sum of the blocks at (x_0, v_0), and (df/dv) v_0 is q times the damping force,
// which is homogeneous of degree q in the velocities. Held displacements u_0 are known: what is
// solved for is w = u - u_0 from A w = right-hand side - A u_0.
void single_linearisation(Group& group, const StepContext& context) {
  const double dt = context.dt;
  start_bodies(group);
  forget_bodies(group);
  clear_loads(group);
  for (Chain* c : group.chains) {
    c->b = dt;
    forces_now(*c, context, true, 1 - c->material.law.damping_exponent);
  }
  rows_now(group, true);
  for (Chain* c : group.chains) {
    c->anchor_x = c->x;
    add_stiff_holds_and_inertia(*c, dt);
    for (int k = 0; k < 3; ++k) std::fill_n(c->cg_direction[k], c->n(), 0.0);
    for (const Hold& h : c->holds)
      if (h.rigid) c->cg_direction.set(h.particle, h.aim - c->x.at(h.particle));
  }
  multiply(group);
  for (Chain* c : group.chains)
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) c->residual[k][i] += c->cg_image[k][i];
  for (Chain* c : group.chains) c->goal = c->cg_direction;  // u_0
  load_carried(group, &Chain::residual);
  for (Row* row : group.rows)
    if (row->moves && row->normal_force > 0)
      load_body(group, *row, -1.0 * (row->block * row->a.of(group.at(row->a).goal)));
  start_body_residual(group, 1);
  make_border(group, true);
  project_holds(group, &Chain::residual);
  hold_in_matrix(group);
  solve_linear(group, context, true);
  for (Chain* c : group.chains) {
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) {
        c->step[k][i] += c->goal[k][i];
        c->next[k][i] = c->x[k][i] + c->step[k][i];
      }
  }
  advance_bodies(group, 1);
  for (Row* row : group.rows) predict(group, *row);
  settle_rows(group);
  for (Chain* c : group.chains)
    for (Hold& h : c->holds) h.force = predicted_hold_force(group, *c, h, context);
  group.iterations = 1, group.converged = true;
}

}  // namespace bt
