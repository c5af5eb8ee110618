// The methods of the paper: explicit Euler (6) and one linearisation of implicit Euler (8), (9).
#include <algorithm>
#include <utility>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// tendon.residual = minus all forces except those of anchors and contacts, at (x, v), with damping forces
// times `damping_share`. matrix: adds their blocks to tendon.matrix.
void forces_now(Tendon& c, const StepContext& context, bool matrix, double damping_share) {
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
  if (matrix) add_bending_blocks(c);
}

void contacts_now(Island& island, bool matrix) {
  for (Contact* contact : island.contacts) {
    contact->normal_force.direct = false;
    const Vec3 relative = relative_position(island, *contact, &Tendon::x);
    contact->limit_friction(0);
    contact->evaluate(relative, true);  // first for the normal force, which limits friction
    contact->limit_friction(contact->normal_force.value);
    contact->evaluate(relative, true);
    if (contact->normal_force.value <= 0) continue;
    exert(island, *contact, contact->force.total, &Tendon::residual);
  }
  if (matrix) linearise_contacts(island, false, true);
}

Vec3 anchor_velocity(const Tendon& c, const Anchor& h, double dt) {
  return (1 / dt) * (h.target.aim - c.x.at(h.particle));
}

void add_stiff_anchors_and_inertia(Tendon& c, double dt) {
  for (Anchor& h : c.anchors) {
    if (h.rigid) continue;
    h.evaluate(c.x.at(h.particle), {});
    c.residual.add(h.particle, h.linearised());
    c.matrix.add(h.particle, h.block(h.slope(dt)));
  }
  for (int i = 0; i < c.n(); ++i) {
    c.residual.add(i, (-c.mass[i] / dt) * c.v.at(i));
    for (int plane : {0, 3, 5}) c.matrix.diagonal[plane][i] += c.mass[i] / (dt * dt);
  }
}

// The force of a contact after the displacements, by the linearisation that the solution used.
void predict(Island& island, Contact& contact) {
  if (contact.normal_force.value <= 0) return;
  contact.force.total -= contact.force.block * relative_position(island, contact, &Tendon::displacement);
  contact.normal_force.value = dot(contact.force.total, contact.geometry.normal);
  contact.friction.force = without(contact.force.total, contact.geometry.normal);
}

void settle_contacts(Island& island) {
  for (Contact* contact : island.contacts)
    contact->settle(relative_position(island, *contact, &Tendon::x_new));
}

Vec3 spring_forces_after(const Tendon& c, int i) {
  Vec3 sum;
  for (const SpringSet* s : {&c.structure, &c.shear})
    for (int end : {0, 1}) {
      int k = end ? i - s->reach : i, other = end ? k : i + s->reach;
      if (k < 0 || k >= s->count) continue;
      Vec3 f{s->vector[0][k], s->vector[1][k], s->vector[2][k]};
      sum += (end ? -1.0 : 1.0) * f +
             symmetric_at(s->block, k) * (c.displacement.at(other) - c.displacement.at(i));
    }
  return sum;
}

// Force on the anchor after the displacements [N]: the particle's other forces minus mass times acceleration.
Vec3 predicted_anchor_force(const Island& island, const Tendon& c, const Anchor& h,
                            const StepContext& context) {
  const int i = h.particle;
  const Vec3 u = c.displacement.at(i);
  if (h.is_line) return h.linearised() + h.line.block() * (u - (h.line.end - h.target.aim));
  if (!h.rigid) return h.linearised() + h.block(h.slope(context.dt)) * u;
  Vec3 needs = (c.mass[i] / (context.dt * context.dt)) * (u - context.dt * c.v.at(i));
  Vec3 has = c.mass[i] * context.gravity + c.force.at(i) + spring_forces_after(c, i) +
             bending_force(c, c.x, c.displacement, i);
  for (const Contact* contact : island.contacts)
    for (const auto& [spot, sign] : {std::pair{contact->a, 1.0}, std::pair{contact->b, -1.0}}) {
      if (spot.tendon < 0 || contact->normal_force.value <= 0 || &island.at(spot) != &c) continue;
      if (i == spot.first) has += (sign * spot.w0) * contact->force.total;
      if (i == spot.first + 1) has += (sign * spot.w1) * contact->force.total;
    }
  return has - needs;
}

}  // namespace

// (6): (dx, dv) = dt (v_0, M^-1 f_0).
void explicit_euler(Island& island, const StepContext& context) {
  const double dt = context.dt;
  for (Tendon* c : island.tendons) forces_now(*c, context, false, 1);
  contacts_now(island, false);
  for (Tendon* c : island.tendons) {
    c->h_eff = dt;
    for (Anchor& h : c->anchors) {
      if (h.rigid || h.exact) continue;
      h.evaluate(c->x.at(h.particle), c->v.at(h.particle));
      c->residual.add(h.particle, h.force.total);
    }
    for (int i = 0; i < c->n(); ++i) {
      c->x_new.set(i, c->x.at(i) + dt * c->v.at(i));
      c->v_new.set(i, c->v.at(i) - (dt / c->mass[i]) * c->residual.at(i));
    }
    for (Anchor& h : c->anchors) {
      if (!h.rigid && !h.exact) continue;
      Vec3 v = anchor_velocity(*c, h, dt), before = c->v.at(h.particle);
      const Vec3 needed = -((c->mass[h.particle] / dt) * (v - before) + c->residual.at(h.particle));
      h.force.total = h.limited(needed);
      h.slips = h.exceeds_limit(needed);
      if (h.slips) {
        c->v_new.add(h.particle, (-dt / c->mass[h.particle]) * h.force.total);
        continue;
      }
      c->place(h.particle, h.target.aim);
      c->v_new.set(h.particle, v);
    }
  }
  settle_contacts(island);
  island.result.converged = true;
}

// (9): (M - dt df/dv - dt^2 df/dx) dv = dt (f_0 + dt df/dx v_0), solved for the displacements u = dt (v_0 +
// dv). Divided by dt^2 it reads
//
//   A u = M v_0/dt + f_0 - (df/dv) v_0,     A = M/dt^2 - df/dx - (df/dv)/dt.
//
// A is the sum of the blocks at (x_0, v_0). (df/dv) v_0 is q times the damping force, which is homogeneous of
// degree q in the velocities. The displacements u_0 of anchored particles are known. The system is solved for
// w = u - u_0: A w = right-hand side - A u_0.
void single_linearisation(Island& island, const StepContext& context) {
  const double dt = context.dt;
  start_bodies(island);
  put_bodies_aside(island);
  clear_loads(island);
  clear_pulls(island);
  for (Tendon* c : island.tendons) {
    c->h_eff = dt;
    forces_now(*c, context, true, 1 - c->material.law.damping_exponent);
  }
  contacts_now(island, true);
  for (Tendon* c : island.tendons) {
    c->history = 0;
    add_stiff_anchors_and_inertia(*c, dt);
    for (int k = 0; k < 3; ++k) std::fill_n(c->cg_direction[k], c->n(), 0.0);
    for (const Anchor& h : c->anchors)
      if (h.rigid) c->cg_direction.set(h.particle, h.target.aim - c->x.at(h.particle));
  }
  multiply(island);
  for (Tendon* c : island.tendons)
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) c->residual[k][i] += c->cg_image[k][i];
  for (Tendon* c : island.tendons) c->displacement = c->cg_direction;  // u_0
  load_carried(island, &Tendon::residual);
  load_lines(island, false);
  load_lines(island, true);
  for (Contact* contact : island.contacts)
    if (contact->moves && contact->normal_force.value > 0)
      load_body(island, *contact,
                -1.0 * (contact->force.block * contact->a.of(island.at(contact->a).displacement)));
  start_body_residual(island, 1);
  make_border(island, true);
  project_anchors(island, &Tendon::residual);
  fix_in_matrix(island);
  solve_linear(island, context, true);
  for (Tendon* c : island.tendons) c->advance(1);
  advance_bodies(island, 1);
  for (Contact* contact : island.contacts) predict(island, *contact);
  settle_contacts(island);
  for (Tendon* c : island.tendons)
    for (Anchor& h : c->anchors) {
      h.force.total = predicted_anchor_force(island, *c, h, context);
      if (h.is_line)
        h.line.predict(c->displacement.at(h.particle) - (h.line.end - h.target.aim));
      else if (!h.rigid)
        h.predict(h.raw + h.slope(dt) * c->displacement.at(h.particle));
    }
  for (Tendon* c : island.tendons) find_velocities(*c);
  island.result.iterations = 1;
  island.result.converged = true;
}

}  // namespace bt
