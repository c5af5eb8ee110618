#include "bodies/body_history.h"

#include <cstddef>

#include "bodies/body_response.h"

namespace bt {

void BodyHistory::forget() {
  mean.clear();
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
  history.begin(dt, whole);
  if (!history.continues) return;
  dense::respond(root, history.given, work_.half, work_.known);
  for (int i = 0; i < n(); ++i) change[i] += dt * work_.known[i];
  for (double& e : root) e *= history.share();
}

std::pair<double, double> GeneralizedBody::energies_of_change(double dt, Vec3 gravity) {
  const double mass = 1 / free[0];
  Numbers wrench{mass * gravity.x, mass * gravity.y, mass * gravity.z, 0, 0, 0};
  for (size_t i = 0; i < external.size(); ++i) wrench[i] += external[i];
  auto energy = [&] {
    dense::respond(root, wrench, work_.half, work_.known);
    return dt * dt * dense::dot(wrench, work_.known);
  };
  const double known = energy();
  for (int i = 0; i < n(); ++i) wrench[i] += forces[i];
  return {known, energy()};
}

}  // namespace bt
