#include "bodies/body_response.h"

#include <cmath>
#include <cstddef>

#include "math/rounding.h"

namespace bt {

namespace {

// If the rotation of a body in a step is larger, arms are those at the end of the step [rad]. It is also the
// largest dt^2 |f| |r| times the mean inverse moment of inertia, the rotation that the force f could cause by
// the arm r. Larger: attached points lag behind, and the swing of light bodies on taut tendons grows.
// Smaller: the swing of a body that hangs on an arm is damped.
constexpr double kFarTurn = 0.1;
// A body is owed no motion if its rates differ from those that it was left with by more than this share of
// them, as velocities whose energies are compared [-]. Larger: what was stopped starts again. Smaller: pushes
// of pybullet that are not known end a motion.
constexpr double kElsewhere = 0.5;
// Newton steps for the spin at the end of a step. At a radian in a step, five end within rounding.
constexpr int kMidpointSteps = 6;

}  // namespace

// The implicit midpoint rule in axes that turn with the body: energy and momentum are conserved. pybullet
// keeps the spin in a step, which has the same components in these axes before and after it.
Vec3 Inertia::gyroscopic_shift(Vec3 w, double dt) const {
  const Vec3 explicitly = cross(w, moments * w);
  if (norm(explicitly) == 0) return {};
  Vec3 end = w;
  for (int k = 0; k < kMidpointSteps; ++k) {
    const Vec3 mean = 0.5 * (w + end), momentum = moments * mean;
    const Vec3 residual = moments * (end - w) + dt * cross(mean, momentum);
    auto column = [&](Vec3 e) {
      const Vec3 inertial = moments * e;
      return inertial + 0.5 * dt * (cross(e, momentum) + cross(mean, inertial));
    };
    const Vec3 x = column({1, 0, 0}), y = column({0, 1, 0}), z = column({0, 0, 1}), across = cross(y, z);
    const double volume = dot(x, across);
    end -= (1 / volume) * Vec3{dot(residual, across), dot(residual, cross(z, x)), dot(residual, cross(x, y))};
  }
  return explicitly + (1 / dt) * (moments * (end - w));
}

// Acceleration by gravity and by its own motion alone.
const Numbers& GeneralizedBody::known(Vec3 gravity) {
  work_.known.assign(n(), 0.0);
  if (gravity_response.empty()) return work_.known;
  for (int i = 0; i < n(); ++i)
    work_.known[i] = gravity_response[3 * i] * gravity.x + gravity_response[3 * i + 1] * gravity.y +
                     gravity_response[3 * i + 2] * gravity.z;
  if (by_motion.size() == work_.known.size()) dense::add(work_.known, 1, by_motion);
  return work_.known;
}

double GeneralizedBody::share_that_holds(const Numbers& y, double dt) const {
  const double taken_back = -dense::dot(last_forces(), change), all = dt * dense::dot(y, y);
  return taken_back <= 0 ? 0 : taken_back >= all ? 1 : taken_back / all;
}

// The same as it was in the step, plus the acceleration by pybullet's stops.
const Numbers& GeneralizedBody::unforced() {
  work_.known.assign(n(), 0.0);
  if (known_in_step_.size() == work_.known.size()) work_.known = known_in_step_;
  const Numbers& stopped = stops.accelerates();
  if (stopped.size() == work_.known.size()) dense::add(work_.known, 1, stopped);
  return work_.known;
}

void GeneralizedBody::sense() {
  JointMotors& motors = stops.motors;
  motors.begin_step();
  stops.begin_step();
  Numbers by_motors;
  if (observer.has_acted()) {
    stops.doubt(rates);
    const Numbers reached(observer.reached(rates));
    stops.watch_constraints(reached, observer.dt());
    by_motors = explain_stops(motors.reported, reached);
    motors.reported_before = motors.reports;
    if (by_motors.size() == rates.size()) motors.thrown = motors.observe(reached, by_motors, observer.dt());
  } else {
    motors.begin(rates);
  }
  // With several tendons, or contacts of them, the motion without a cut-off is not known.
  const bool alone = !gravity_response.empty() && !is_jointed() && (touches == 1 || turning.far);
  // Where limits and motors act together, or a motor has yielded, pybullet's sweeps may end far from the
  // rates that are expected.
  const bool rough = motors.thrown || (motors.any() && stops.limits_act());
  const double noise = rough ? kUnlimited : stops.act() ? kSolverNoise : 0;
  observer.observe(
      rates, free, unforced(),
      {alone, is_jointed(), stops.contacts_stop(), stops.constraints_act(), noise, by_motors, motors.thrown});
  if (inertia.is_slender()) observer.turn_to(inertia.axes, free);
  take_owed();
  stops.contacts_known = motors.reported_known = false;
}

// A body that has other rates than it was left with was stopped, or set by the user.
void GeneralizedBody::take_owed() {
  bool owes = left_out.kept.size() == rates.size();
  if (owes) {
    work_.half = rates;
    dense::add(work_.half, -1, left_out.kept);
    owes = energy_of(work_.half) <= kElsewhere * kElsewhere * energy_of(left_out.kept);
  }
  if (!owes) left_out.owed.clear();
  left_out.kept.clear();
  left_out.force.clear();
}

void GeneralizedBody::give_owed(double dt) {
  left_out.force.resize(n());
  for (int i = 0; i < n(); ++i) left_out.force[i] = left_out.owed[i] / dt;
  dense::add(change, 1, left_out.owed);
  dense::solve(observer.free_root(), left_out.force);
}

void GeneralizedBody::leave_out(double share, double dt) {
  left_out.kept.resize(n());
  left_out.owed.resize(n());
  left_out.force.resize(n());
  for (int i = 0; i < n(); ++i) {
    const double rate = rates[i] + substep.changed[i], known = change[i] - left_out.owed[i];
    left_out.kept[i] = share * rate;
    left_out.force[i] = (left_out.kept[i] - rates[i] - known) / dt;
    left_out.owed[i] = (1 - share) * rate;
  }
  dense::solve(observer.free_root(), left_out.force);
  for (int i = 0; i < n(); ++i) left_out.force[i] -= substep.pushed[i] / dt;
}

// Finds what pybullet's stops did in a step in which it reached these rates. Returns the forces of its
// motors, by what pybullet reports of them.
Numbers GeneralizedBody::explain_stops(const Numbers& reported, const Numbers& reached) {
  JointMotors& motors = stops.motors;
  Numbers by_motors =
      observer.forces_of_motors(reached, unforced(), {motors.reported_before, reported, motors.off});
  if (any_push(by_motors)) motors.add_cut_off(reached, observer.cut_off(known_in_step_), by_motors);
  stops.explain(stopped(), forces, by_motors);
  return by_motors;
}

bool GeneralizedBody::sample(const Numbers& after, const Numbers& reported) {
  const Numbers by_motors = explain_stops(reported, after);
  return observer.sample(after, unforced(), by_motors) || stops.motors.released(after, by_motors) ||
         stops.broke(after);
}

const Numbers& GeneralizedBody::rates_at_end(double dt) {
  rates_under(forces, rates, root, change, dt, work_.half, work_.known);
  return work_.known;
}

bool GeneralizedBody::limit_hold(double dt) {
  work_.forces = forces;
  for (size_t i = 0; i < stops.motors.all.size(); ++i) work_.forces[i] += stops.motors.all[i].needed;
  return observer.limit_hold(work_.forces, dt);
}

bool GeneralizedBody::settle_stops(double dt) {
  if (!stops.any() || !stops.choose(stopped(), forces, dt)) return false;
  stops.act_on(stopped(), dt);
  return true;
}

bool GeneralizedBody::stops_settled(double dt) {
  return !stops.any() || !stops.would_change(stopped(), forces, dt);
}

void GeneralizedBody::add_external(const Numbers& force) {
  external.resize(n());
  dense::add(external, 1, force);
}

void GeneralizedBody::predict(double dt, Vec3 gravity) {
  known_in_step_ = known(gravity);
  change = known_in_step_;
  for (int i = 0; i < n(); ++i) change[i] = dt * (change[i] + observer.push()[i]);
  if (!left_out.owed.empty()) give_owed(dt);
  root = observer.root();
  motion_lacks.clear();
  const Vec3 torque = n() == 6 ? inertia.gyroscopic_shift({rates[3], rates[4], rates[5]}, dt) : Vec3{};
  if (norm(torque) > 0) motion_lacks = {0, 0, 0, torque.x, torque.y, torque.z};
  if (!external.empty() || !motion_lacks.empty()) {
    work_.forces = external;
    work_.forces.resize(n());
    dense::add(work_.forces, 1, motion_lacks);
    dense::respond(root, work_.forces, work_.half, work_.known);
    dense::add(change, dt, work_.known);
  }
  stops.find(stopped(), base(), dt);
  if (!stops.any() || observer.forces().size() != rates.size()) return;
  if (!stops.motors.again) stops.choose(stopped(), observer.forces(), dt);
  stops.act_on(stopped(), dt);
}

bool GeneralizedBody::turns_far(Vec3 spin, double dt) const {
  Vec3 by;
  double light = 0;
  for (int k = 0; k < 6; ++k) {
    const Vec3 e{root[18 + k], root[24 + k], root[30 + k]};
    by += dot(e, turning.torque) * e;
    light += dot(e, e);
  }
  if (history.admitted && turning.lever * turning.lever * light > kRoundingShare * free[0]) return true;
  const Vec3 turn = dt * (spin + dt * by);
  return norm(turn) > kFarTurn || dt * dt * light / 3 * turning.pull > kFarTurn;
}

void GeneralizedBody::act(double dt) {
  stops.rest(n());
  joint_forces.assign(n(), 0.0);
  dense::add(forces, 1, left_out.force);
  stops.share(stopped(), forces, dt, joint_forces);
  dense::add(forces, -1, left_out.force);
  dense::add(joint_forces, 1, left_out.force);
  dense::add(joint_forces, 1, motion_lacks);
  if (history.admitted && history.coupled && !stops.act()) {
    history.steady_share = 1;
    history.dt = dt;
  } else {
    history.forget();
  }
  work_.known = joint_forces;
  dense::add(work_.known, 1, external);
  observer.act(forces, work_.known, dt);
}

void GeneralizedBody::begin_step() {
  substep.pushed.assign(n(), 0.0);
  substep.last_forces.clear();
}

void GeneralizedBody::push(const Numbers& impulse, double h) {
  substep.last_forces = impulse;
  for (int i = 0; i < n(); ++i) {
    substep.pushed[i] += impulse[i];
    substep.last_forces[i] /= h;
  }
}

// What else acts does so evenly over the step, as the tendons do: what is in balance does not move. The
// motion that is owed is there from the start.
void GeneralizedBody::begin_substep(double before, double at_end) {
  substep.changed.assign(n(), 0.0);
  if (dense::dot(substep.pushed, substep.pushed) > 0)
    dense::respond(root, substep.pushed, work_.half, substep.changed);
  substep.changes_to = substep.changed;
  dense::add(substep.changed, before, change);
  dense::add(substep.changed, 1 - before, left_out.owed);
  dense::add(substep.changes_to, at_end, change);
  dense::add(substep.changes_to, 1 - at_end, left_out.owed);
}

}  // namespace bt
