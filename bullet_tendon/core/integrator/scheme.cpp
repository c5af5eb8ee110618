#include "integrator/scheme.h"

#include <algorithm>
#include <chrono>
#include <functional>
#include <utility>

#include "bodies/body_history.h"

namespace bt {

namespace {

// A tendon that something stops takes its next step by implicit Euler if its velocities differ from their
// linear extrapolation by more than this: squared difference over squared velocities, weighted by mass [-].
// Larger: heaps keep vibrating with BDF2. Smaller: a tendon in contact that swings with a period of more than
// about 17 steps loses second order.
constexpr double kRough = 0.01;

bool moves_body(const Tendon& c) {
  return std::any_of(c.anchors.begin(), c.anchors.end(),
                     [](const Anchor& h) { return h.moves || (h.link >= 0 && !h.rigid && !h.is_line); });
}

}  // namespace

BT_VECTOR void begin_step(Tendon& c, const StepContext& context) {
  const double dt = context.dt;
  // Velocities are extrapolated where no contact has begun or ended, and none of them has jumped.
  const bool history = c.dt_before > 0 && c.smooth;
  const Integrator method = context.options.integrator;
  // Within a divided step, a tendon in contact or on a body that moves takes implicit Euler. So do all
  // tendons where the step was cut because something is near: only that method removes the energy that a step
  // creates (solver/energy_projection.cpp).
  const bool second_order =
      is_second_order(method) &&
      (context.substeps->is_whole() || !(c.touched || moves_body(c) || context.substeps->was_cut()));
  const double growth = c.dt_before > 0 ? dt / c.dt_before : 0;
  const bool two =
      second_order && growth > 0 && growth <= kMostGrowth && c.smooth && (!c.with_body || growth == 1);
  if (!two && c.with_body) c.v = c.user_velocities();
  const double last = two ? -growth * growth / (1 + 2 * growth) : 0;
  c.history = last;
  c.h_eff = two ? dt * (1 + growth) / (1 + 2 * growth) : dt;
  const double g[3] = {context.gravity.x, context.gravity.y, context.gravity.z};
  // Starting guess x + dt v + ahead (v - v_before).
  const double ahead = history ? (two ? 0.5 : 1.0) * dt * std::min(1.0, dt / c.dt_before) : 0;
  for (int k = 0; k < 3; ++k) {
    const double *x = c.x[k], *v = c.v[k], *xb = c.x_before[k], *vb = c.v_before[k], *f = c.force[k];
    double *y = c.inertial_displacement[k], *u = c.displacement[k], *x_new = c.x_new[k];
    const double* mass = c.mass.data();
    const double b = c.h_eff;
    const int n = c.n();
#pragma GCC ivdep
    for (int i = 0; i < n; ++i) {
      const double vh = v[i] + last * (vb[i] - v[i]);
      y[i] = last * (xb[i] - x[i]) + b * vh + b * b * (g[k] + f[i] / mass[i]);
      u[i] = dt * v[i] + ahead * (v[i] - vb[i]);
      x_new[i] = x[i] + u[i];
    }
  }
  for (SpringSet* s : {&c.structure, &c.shear}) {
    if (s->count == 0 || c.material.damping == 0) continue;
    measure(*s, c.x);
    s->start = s->history = s->length;
    if (!two) continue;
    measure(*s, c.x_before);
    // What a spring that only pulls did while it was slack is no stretch of it, and no rate.
    for (int k = 0; k < s->count; ++k) {
      const double least = c.material.law.tension_only ? s->rest[k] : 0;
      s->history[k] += last * (std::max(s->length[k], least) - std::max(s->start[k], least));
    }
  }
  c.begin_tissue(method == Integrator::explicit_euler ? 0 : context.tissue_time);
}

BT_VECTOR void find_velocities(Tendon& c) {
  for (int k = 0; k < 3; ++k) {
    const double *x = c.x[k], *u = c.displacement[k], *xb = c.x_before[k];
    double* v = c.v_new[k];
#pragma GCC ivdep
    for (int i = 0; i < c.n(); ++i) v[i] = (u[i] - c.history * (xb[i] - x[i])) / c.h_eff;
  }
}

void finish_step(Tendon& c, const StepContext& context) {
  const bool may_stop = c.touched || c.material.law.tension_only;
  c.smooth &= !may_stop || !is_jolted(c, context.dt);
  c.x_before = c.x;
  c.v_before = c.v;
  c.x = c.x_new;
  c.v = c.v_new;
  if (c.with_body && c.history == 0) c.mean_velocities = c.v;
  for (int k = 0; c.with_body && c.history != 0 && k < 3; ++k)
    for (int i = 0; i < c.n(); ++i)
      c.mean_velocities[k][i] += kTwoStepShare * (c.v[k][i] - c.mean_velocities[k][i]);
  c.steady_share = 1;
  for (Anchor& h : c.anchors) {
    if (h.rigid && !h.moves) c.x.set(h.particle, h.target.aim);  // without the rounding of the displacement
    h.target.last_aim = h.target.aim;
    h.line.let_slip();
  }
  c.dt_before = context.dt;
  c.end_tissue(context.tissue_time);
}

// Restart of BDF2 by a step of implicit Euler, for tendons in contact, and for those whose springs only pull:
// slack ones that become taut stop their particles as contacts do.
//
// BDF2 retains velocities from before an impact. A particle of velocity V that a wall stops leaves the wall
// with the following velocities, where h is its distance from the wall at the start of the step:
//
//   v_1 = V/2 - 3 h/(2 dt),     v_2 = (4 v_1 + V)/3,     ...     v_1 + (3/2) (v_2 - v_1),
//
// up to 5/4 V. A heap, in which particles are stopped all the time, would never come to rest. Therefore BDF2
// does not continue where the velocities of such a tendon differ from the extrapolation of their last
// change: the step in which they jump is solved again by implicit Euler, and so is the next one. It continues
// one step after the motion is smooth again, so that smooth motion in contact keeps second order.

bool is_jolted(const Tendon& c, double dt) {
  const double growth = c.dt_before > 0 ? dt / c.dt_before : 0;
  // Sums of m v^2 over the particles [J]: of the difference between the velocities and the extrapolation of
  // their last change, and of the velocities at both ends of the step.
  double jump = 0, all = 0;
  for (int k = 0; k < 3; ++k) {
    const double *now = c.v_new[k], *v = c.v[k], *before = c.v_before[k];
    for (int i = 0; i < c.n(); ++i) {
      const double off = now[i] - v[i] - growth * (v[i] - before[i]);
      jump += c.mass[i] * off * off;
      all += c.mass[i] * (now[i] * now[i] + v[i] * v[i]);
    }
  }
  return jump > kRough * all;
}

namespace {

// Linear solutions between two polls [-]. Larger: Ctrl-C takes longer. Smaller: the interpreter is locked
// more often than necessary.
constexpr long kBetweenPolls = 64;

}  // namespace

void Budget::start(long most, double seconds, std::function<void()> poll) {
  most_ = most;
  spent_ = allowed_ = 0;
  longest_ = {};
  exhausted_ = refused_ = false;
  timed_ = seconds > 0;
  if (timed_)
    end_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  poll_ = std::move(poll);
}

void Budget::begin_solution(long beyond) {
  allowed_ = spent_ + beyond;
  if (timed_) last_ = Clock::now();
}

void Budget::spend() {
  ++spent_;
  if (timed_) {
    const auto now = Clock::now();
    longest_ = std::max(longest_, now - last_);
    last_ = now;
    exhausted_ |= now + kKept * longest_ >= end_;
  }
  exhausted_ |= spent_ >= most_;
  if (poll_ && spent_ % kBetweenPolls == 0) poll_();
}

}  // namespace bt
