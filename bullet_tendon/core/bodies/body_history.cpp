#include "bodies/body_history.h"

#include <algorithm>
#include <cstddef>

#include "bodies/body_response.h"

namespace bt {

namespace {

// Change of the known forces from one step to the next from which BDF2 begins anew, as a share of the larger
// ones [-]. Larger: a tendon that holds a body against a force that begins at once overshoots it, by up to
// half of the change. Smaller: forces that vary smoothly interrupt the second order.
constexpr double kSuddenly = 0.3;

}  // namespace

void BodyHistory::forget() {
  mean.clear();
  known.clear();
  applied.clear();
  given.clear();
  dt = 0;
  smooth = admitted = continues = false;
}

void BodyHistory::begin(double step, bool whole) {
  admitted = whole;
  continues = whole && smooth && dt == step;
  given.clear();
  if (!continues) return;
  given.resize(mean.size());
  for (std::size_t i = 0; i < mean.size(); ++i) given[i] = 2.0 / 9 * mean[i] + steady_share / 3 * applied[i];
}

void BodyHistory::finish(const Numbers& forces, double step, bool whole) {
  mean = forces;
  for (std::size_t i = 0; continues && i < mean.size(); ++i)
    mean[i] = 1.5 * forces[i] - 0.5 * steady_share * applied[i];
  applied = forces;
  steady_share = 1;
  dt = whole ? step : 0;
}

void GeneralizedBody::continue_history(double dt, Vec3 gravity, bool whole) {
  if (!history.possible || may_stop() || observer.held() || observer.is_surprised(unforced()))
    return history.forget();
  predict(dt, gravity);
  history.smooth &= !is_jerked();
  history.begin(dt, whole);
  if (!history.continues) return;
  dense::respond(root, history.given, work_.half, work_.known);
  for (int i = 0; i < n(); ++i) change[i] += dt * work_.known[i];
  for (double& e : root) e *= history.share();
}

double GeneralizedBody::energy_of(const Numbers& acceleration) {
  work_.along = acceleration;
  dense::forward(observer.free_root(), work_.along);
  return dense::dot(work_.along, work_.along);
}

GeneralizedBody::Numbers GeneralizedBody::known_acceleration() {
  Numbers acceleration = known_in_step_;
  if (!external.empty()) {
    dense::multiply(free, external, work_.known);
    for (int i = 0; i < n(); ++i) acceleration[i] += work_.known[i];
  }
  return acceleration;
}

bool GeneralizedBody::is_jerked() {
  if (history.known.empty()) return false;
  const Numbers now = known_acceleration();
  work_.half = now;
  for (int i = 0; i < n(); ++i) work_.half[i] -= history.known[i];
  return energy_of(work_.half) > kSuddenly * kSuddenly * std::max(energy_of(now), energy_of(history.known));
}

std::pair<double, double> GeneralizedBody::energies_of_change(double dt) {
  Numbers all = known_acceleration();
  const double before = energy_of(history.known.empty() ? all : history.known);
  dense::multiply(free, forces, work_.known);
  for (int i = 0; i < n(); ++i) all[i] += work_.known[i];
  return {dt * dt * before, dt * dt * energy_of(all)};
}

}  // namespace bt
