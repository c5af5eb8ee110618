// TR-BDF2 (Bank and others 1985; Hosea and Shampine 1996): with g = 2 - sqrt(2), the trapezoidal rule
// over g dt, then BDF2 over the rest. Both stages have the step weight b = g dt/2 and the form of
// stepping.h, with
//
//   first    xh = x_0 + b v_0,                          vh = v_0 + b a_0
//   second   xh = ((1 + sqrt 2) x_g + (1 - sqrt 2) x_0)/2,   vh likewise,
//
// so that each is one Newton solution. a_0 is what the last step ended with, (v - vh)/b. The mean of a
// force over the step is sqrt(2)/4 (F_0 + F_g) + g/2 F_1, which is what momentum changes by.
#include <cmath>

#include "stepping.h"

namespace bt {

namespace {

const double kRoot = std::sqrt(2.0), kShare = 2 - kRoot;  // g
const double kOuter = kRoot / 4, kInner = kShare / 2;     // weights of the mean

bool applies(const Group& group) {
  if (!group.rows.empty()) return false;
  for (const Chain* c : group.chains) {
    if (!c->accelerated) return false;
    for (const Hold& h : c->holds)
      if (h.link >= 0 && (!h.rigid || h.moves)) return false;
  }
  return true;
}

// The goal from the anchors, and a guess: `from` and its velocity and acceleration, dt later.
void set_goal(Chain& c, Vec3 gravity, const Field& from, const Field& v, const Field& a, double dt) {
  const double b = c.b, g[3] = {gravity.x, gravity.y, gravity.z};
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < c.n(); ++i) {
      c.goal[k][i] = c.anchor_x[k][i], c.goal_tail[k][i] = c.next_tail[k][i] = 0;
      add_exactly(c.goal[k][i], c.goal_tail[k][i],
                  b * c.anchor_v[k][i] + b * b * (g[k] + c.force[k][i] / c.mass[i]));
      c.next[k][i] = from[k][i] + dt * (v[k][i] + 0.5 * dt * a[k][i]);
    }
}

void aim_holds(Chain& c, double share) {
  for (Hold& h : c.holds) {
    const Vec3 from = h.rigid ? c.x.at(h.particle) : h.target_before;
    h.target = share == 1 ? h.aim : (1 - share) * from + share * h.aim;
    if (h.rigid) c.next.set(h.particle, h.target);
  }
}

void start_lengths(SpringSet& s, const Chain& c) {
  measure(s, c.x);
  for (int k = 0; k < s.count; ++k) {
    const Vec3 along{s.direction[0][k], s.direction[1][k], s.direction[2][k]};
    s.start[k] = s.length[k];
    s.history[k] = s.start[k] + c.b * dot(along, c.v.at(k + s.reach) - c.v.at(k));
  }
}

void start_first(Chain& c, const StepContext& context) {
  c.b = kInner * context.dt;
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < c.n(); ++i) {
      c.anchor_x[k][i] = c.x[k][i] + c.b * c.v[k][i];
      c.anchor_v[k][i] = c.v[k][i] + c.b * c.acceleration[k][i];
    }
  set_goal(c, context.gravity, c.x, c.v, c.acceleration, kShare * context.dt);
  for (SpringSet* s : {&c.structure, &c.shear})
    if (s->count && c.material.damping > 0) start_lengths(*s, c);
  for (Hold& h : c.holds) h.mean_force = kOuter * h.force;
  aim_holds(c, kShare);
}

void start_second(Chain& c, const StepContext& context) {
  const double now = 0.5 * (1 + kRoot), last = 0.5 * (1 - kRoot);
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < c.n(); ++i) {
      const double x = c.next[k][i], v = (x - c.anchor_x[k][i] + c.next_tail[k][i]) / c.b;
      c.step[k][i] = (v - c.anchor_v[k][i]) / c.b;
      c.stage_x[k][i] = x, c.stage_v[k][i] = v;
      c.anchor_x[k][i] = now * x + last * c.x[k][i];
      c.anchor_v[k][i] = now * v + last * c.v[k][i];
    }
  for (SpringSet* s : {&c.structure, &c.shear})
    for (int k = 0; k < s->count; ++k) s->history[k] = now * s->length[k] + last * s->start[k];
  set_goal(c, context.gravity, c.stage_x, c.stage_v, c.step, (1 - kShare) * context.dt);
  for (Hold& h : c.holds) h.mean_force += kOuter * h.force;
  aim_holds(c, 1);
}

// As begin_step left it.
void give_up(Group& group, const StepContext& context) {
  for (Chain* c : group.chains) {
    c->restore_multipliers(c->kept);
    for (Hold& h : c->holds) h.mean_force = h.kept_force;
    begin_step(*c, context);
  }
}

}  // namespace

bool two_stages(Group& group, const StepContext& step) {
  if (step.options.integrator != Integrator::tr_bdf2 || !applies(group)) return false;
  StepContext context = step;
  context.goes_on = context.may_look = false;
  for (Chain* c : group.chains) c->staged = true, c->restore_multipliers(c->kept), start_first(*c, context);
  newton(group, context, false);
  const double first_residual = group.residual;
  if (group.converged) {
    for (Chain* c : group.chains) start_second(*c, context);
    newton(group, context, false);
  }
  if (!group.converged) return give_up(group, context), false;
  group.residual = std::max(group.residual, first_residual);
  for (Chain* c : group.chains)
    for (Hold& h : c->holds) h.mean_force += kInner * h.force;
  group.staged = true;
  return true;
}

}  // namespace bt
