#include "stepping.h"

#include "constants.h"

namespace bt {

BT_VECTOR void begin_step(Chain& c, const StepContext& context) {
  const double dt = context.dt;
  // What touches something has velocities that jump: they are not to be extrapolated.
  const bool history = c.dt_before > 0 && c.smooth && !c.touched;
  const Integrator method = context.options.integrator;
  const bool second_order = is_second_order(method) && !(context.part && c.touched);
  const double growth = c.dt_before > 0 ? dt / c.dt_before : 0;
  const bool two = second_order && growth > 0 && growth <= kMostGrowth && c.smooth;
  const double last = two ? -growth * growth / (1 + 2 * growth) : 0, now = 1 - last;
  c.b = two ? dt * (1 + growth) / (1 + 2 * growth) : dt;
  const double g[3] = {context.gravity.x, context.gravity.y, context.gravity.z};
  // Where the method's own velocity would take it; of the second order, where the motion does.
  const double ahead = history ? (two ? 0.5 : 1.0) * dt * std::min(1.0, dt / c.dt_before) : 0;
  for (int k = 0; k < 3; ++k) {
    const double *x = c.x[k], *v = c.v[k], *xb = c.x_before[k], *vb = c.v_before[k], *f = c.force[k];
    double *xh = c.anchor_x[k], *vh = c.anchor_v[k], *y = c.goal[k], *next = c.next[k];
    double *goal_tail = c.goal_tail[k], *next_tail = c.next_tail[k];
    const double* mass = c.mass.data();
    const double b = c.b;
    const int n = c.n();
#pragma GCC ivdep
    for (int i = 0; i < n; ++i) {
      xh[i] = x[i] + last * (xb[i] - x[i]), vh[i] = v[i] + last * (vb[i] - v[i]);
      double goal = xh[i], tail = 0;
      add_exactly(goal, tail, b * vh[i] + b * b * (g[k] + f[i] / mass[i]));
      y[i] = goal, goal_tail[i] = tail;
      next[i] = x[i] + dt * v[i] + ahead * (v[i] - vb[i]), next_tail[i] = 0;
    }
  }
  for (SpringSet* s : {&c.structure, &c.shear}) {
    if (s->count == 0 || c.material.damping == 0) continue;
    if (two) measure(*s, c.x_before), s->before = s->length;
    measure(*s, c.x);
    for (int k = 0; k < s->count; ++k) {
      s->start[k] = s->length[k];
      s->history[k] = now * s->start[k] + (two ? last * s->before[k] : 0);
    }
  }
  for (const Hold& h : c.holds)
    if (h.rigid) c.next.set(h.particle, h.aim);
}

namespace {

BT_VECTOR void read_acceleration(Chain& c) {
  for (int k = 0; k < 3; ++k) {
    double* a = c.acceleration[k];
    const double *v = c.v[k], *vh = c.anchor_v[k];
#pragma GCC ivdep
    for (int i = 0; i < c.n(); ++i) a[i] = (v[i] - vh[i]) / c.b;
  }
}

}  // namespace

BT_VECTOR void finish_step(Chain& c, const StepContext& context) {
  // Explicit Euler and the energy projection leave their velocities in `step`.
  const bool made_known = c.braked || context.options.integrator == Integrator::explicit_euler;
  for (int k = 0; k < 3; ++k) {
    double *x = c.x[k], *v = c.v[k], *xb = c.x_before[k], *vb = c.v_before[k];
    const double *next = c.next[k], *tail = c.next_tail[k], *xh = c.anchor_x[k], *made = c.step[k];
#pragma GCC ivdep
    for (int i = 0; i < c.n(); ++i) {
      xb[i] = x[i], vb[i] = v[i];
      v[i] = made_known ? made[i] : (next[i] - xh[i] + tail[i]) / c.b;
      x[i] = next[i];
    }
  }
  for (Hold& h : c.holds) h.target_before = h.aim;
  if (is_second_order(context.options.integrator)) {
    c.smooth &= !c.touched || goes_smoothly(c, context.dt);
    read_acceleration(c);
  }
  c.dt_before = context.dt;
  c.braked = false;
}

namespace {

// The mean over the step of a force whose value at its end is known: what the momentum of the tendon
// changed by. BDF2, v_1 - v_0 = w^2/(1 + 2 w) (v_0 - v_-1) + b F/M, gives w/(1 + 2 w) of the last one and
// b/dt of F, which are one together.
Vec3 step_mean(const Chain& c, const StepContext& context, Vec3 last_mean, Vec3 force) {
  const double share = c.b / context.dt;
  return share < 1 ? (1 - share) * last_mean + share * force : force;
}

// Finite, and not so far away that lengths could no longer be told from rounding.
bool is_sane(const Chain& c, const StepContext& context) {
  // Explicit Euler leaves its velocities in `step`: where they lead is the next step's matter.
  const bool ahead = context.options.integrator == Integrator::explicit_euler;
  double length = 0;
  for (double l : c.rest) length += l;
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < c.n(); ++i)
      if (!(std::fabs(c.next[k][i] - c.x[k][i]) <= kRunaway * length) ||
          (ahead && !(context.dt * std::fabs(c.step[k][i]) <= kRunaway * length)))
        return false;
  return true;
}

}  // namespace

void solve(Group& group, const StepContext& context) {
  for (Chain* c : group.chains) c->braked = false;
  if (context.options.integrator == Integrator::explicit_euler)
    explicit_euler(group, context);
  else if (context.options.iteration == Iteration::single)
    single_linearisation(group, context);
  else
    converged_step(group, context);
  for (Row* row : group.rows)
    row->mean_force = step_mean(group.at(row->a), context, row->last_mean, row->total_force);
  for (Chain* c : group.chains)
    for (Hold& h : c->holds) {
      h.mean_force = step_mean(*c, context, h.last_mean, h.force);
      if (h.link >= 0) h.mean_torque = torque_of(group, h, h.mean_force);
    }
  for (Chain* c : group.chains) group.finite &= is_sane(*c, context);
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
