#include "bodies/body_history.h"

#include <algorithm>

#include "bodies/body_response.h"

namespace bt {

namespace {

// Change of the known forces from one step to the next from which BDF2 begins anew, as a share of the larger
// ones [-]. Larger: a tendon that holds a body against a force that begins at once overshoots it, by up to
// half of the change. Smaller: forces that vary smoothly interrupt the second order.
constexpr double kSuddenly = 0.3;

}  // namespace

void BodyHistory::forget() {
  known.clear();
  dt = 0;
  smooth = able = admitted = continues = false;
}

bool GeneralizedBody::begin_history(double dt, Vec3 gravity, bool whole) {
  if (!history.asked) {
    history.able = history.possible && !stops.act() && !stops.motors.any() && !stops.contacts_stop() &&
                   !observer.held() && !observer.is_surprised(unforced());
    history.smooth &= history.able && !is_jerked();
    history.asked = true;
  }
  if (history.continues) predict(dt, gravity);  // without what its history gave
  if (!history.able) {
    history.forget();
    return false;
  }
  history.admitted = whole;
  history.continues = whole && history.smooth && history.dt == dt;
  return history.continues;
}

void GeneralizedBody::continue_history(double dt) {
  work_.forces = history.given;
  dense::add(work_.forces, 1, motion_shift);
  dense::add(work_.forces, -1, motion_lacks);  // that of the motion is of second order
  motion_lacks = motion_shift;
  dense::respond(root, work_.forces, work_.half, work_.known);
  dense::add(change, dt, work_.known);
  for (double& e : root) e *= history.share();
}

double GeneralizedBody::energy_of(const Numbers& acceleration) {
  return dense::inverse_square(observer.free_root(), acceleration, work_.along);
}

const Numbers& GeneralizedBody::known_acceleration() {
  Numbers& acceleration = work_.acceleration;
  acceleration = known_in_step_;
  if (by_motion.size() == acceleration.size()) dense::add(acceleration, -1, by_motion);
  if (!external.empty()) {
    dense::multiply(free, external, work_.known);
    dense::add(acceleration, 1, work_.known);
  }
  return acceleration;
}

bool GeneralizedBody::is_jerked() {
  if (history.known.empty()) return false;
  const Numbers& now = known_acceleration();
  work_.half = now;
  dense::add(work_.half, -1, history.known);
  return energy_of(work_.half) > kSuddenly * kSuddenly * std::max(energy_of(now), energy_of(history.known));
}

std::pair<double, double> GeneralizedBody::energies_of_change(double dt) {
  known_acceleration();
  Numbers& all = work_.acceleration;
  const double before = energy_of(history.known.empty() ? all : history.known);
  dense::multiply(free, forces, work_.known);
  dense::add(all, 1, work_.known);
  return {dt * dt * before, dt * dt * energy_of(all)};
}

}  // namespace bt
