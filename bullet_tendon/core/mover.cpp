#include "mover.h"

#include <algorithm>
#include <cmath>

#include "constants.h"

namespace bt {

Vec3 Mover::gyroscopic() const {
  if (falls.empty() || n() != 6) return {};
  auto at = [&](int i, int j) { return free[6 * (3 + i) + 3 + j]; };
  const Sym3 turning{at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)};
  if (!(turning.xx > 0 && turning.yy > 0 && turning.zz > 0)) return {};
  const Vec3 spin{rates[3], rates[4], rates[5]};
  return -(turning * cross(spin, inverse(turning) * spin));
}

// Acceleration without tendons and without what holds it.
const Mover::Numbers& Mover::known(Vec3 gravity) {
  known_.assign(n(), 0.0);
  if (falls.empty()) return known_;
  for (int i = 0; i < n(); ++i)
    known_[i] = falls[3 * i] * gravity.x + falls[3 * i + 1] * gravity.y + falls[3 * i + 2] * gravity.z;
  if (n() == 6) known_[3] += gyration.x, known_[4] += gyration.y, known_[5] += gyration.z;
  return known_;
}

// Limits that were changed (changeDynamics) are told as they were loaded: what goes on through one has none.
void Mover::doubt_stops() {
  doubted_.resize(n());
  for (const Stop& s : stopped_)
    if (s.side * (rates[s.coordinate] - s.wanted) < -kLeastStopped * std::fabs(s.missing))
      doubted_[s.coordinate] = 1, stopped_by_.clear();
}

// The same, with what stops added in the step before, and the gyration of that.
const Mover::Numbers& Mover::unforced(Vec3 gravity) {
  known(gravity);
  if (stopped_by_.size() == known_.size())
    for (int i = 0; i < n(); ++i) known_[i] += stopped_by_[i];
  return known_;
}

void Mover::sense(Vec3 gravity) {
  doubt_stops();
  observer.see(rates, free, unforced(gravity));
  gyration = gyroscopic();
}

void Mover::widen(Numbers direction) {
  const size_t size = direction.size();
  const double whole = dense::dot(direction, direction);
  Numbers along, part;
  for (int twice = 0; twice < 2 && !basis.empty(); ++twice) {  // Gram and Schmidt, to rounding
    dense::multiply(basis, direction, along);
    dense::multiply_transposed(basis, along, part);
    for (size_t i = 0; i < size; ++i) direction[i] -= part[i];
  }
  const double left = dense::dot(direction, direction);
  if (!(left > kSameDirection * whole)) return;
  for (double v : direction) basis.push_back(v / std::sqrt(left));
  ++freedom;
}

bool Mover::note(const Numbers& after, Vec3 gravity) { return observer.note(after, unforced(gravity)); }

void Mover::foresee(double dt, Vec3 gravity) {
  change = known(gravity);
  for (int i = 0; i < n(); ++i) change[i] = dt * (change[i] + observer.push()[i]);
  root = observer.root();
  find_stopped(dt);
  if (!stopped_.empty()) stop(dt);
}

namespace {

// The rate that pybullet gives what is behind a limit: outwards, or none where it is deep.
double rate_at(const double* stop, double dt) {
  return stop[2] < kDeepBehind ? stop[1] * kTakenBack * stop[2] / dt : 0;
}

}  // namespace

// Limits that the coordinates would go on through, with the forces of the last step.
void Mover::find_stopped(double dt) {
  stopped_.clear();
  doubted_.resize(n());
  if (stops.empty()) return;
  dense::respond(root, observer.forces(), half_, known_);
  for (size_t s = 0; s < stops.size(); s += 3) {
    const int i = static_cast<int>(stops[s]);
    double own = 0;
    for (int k = 0; k < n(); ++k) own += root[i * n() + k] * root[i * n() + k];
    const double wanted = rate_at(&stops[s], dt), foreseen = rates[i] + change[i];
    if (!(own > kRank * free[i * n() + i]) || doubted_[i] != 0) continue;
    if (stops[s + 1] * (foreseen + dt * known_[i] - wanted) < 0)
      stopped_.push_back({i, stops[s + 1], wanted, wanted - foreseen});
  }
}

void Mover::stop(double dt) {
  const int m = static_cast<int>(stopped_.size());
  // E_S, and R_SS with its root.
  missing_.assign(m, 0.0), half_.assign(static_cast<size_t>(m) * n(), 0.0);
  for (int a = 0; a < m; ++a) {
    missing_[a] = stopped_[a].missing;
    std::copy_n(&root[stopped_[a].coordinate * n()], n(), &half_[a * n()]);
  }
  dense::product_transposed(n(), half_, half_, within_);
  dense::root(m, within_, within_root_);
  dense::solve(within_root_, missing_);
  Numbers along, gone, row(n());
  dense::multiply_transposed(half_, missing_, gone);
  dense::multiply(root, gone, known_);
  for (int i = 0; i < n(); ++i) change[i] += known_[i];
  stopped_by_ = known_;
  for (double& v : stopped_by_) v /= dt;
  // Each row of E loses what is along those of S.
  for (int i = 0; i < n(); ++i) {
    std::copy_n(&root[i * n()], n(), row.begin());
    dense::multiply(half_, row, along);
    dense::solve(within_root_, along);
    dense::multiply_transposed(half_, along, gone);
    for (int k = 0; k < n(); ++k) root[i * n() + k] -= gone[k];
  }
}

void Mover::act(double dt) {
  observer.act(forces, dt);
  if (stopped_.empty()) return stopped_by_.assign(n(), 0.0);
  auto add_response = [&](const Numbers& of, double sign) {
    dense::respond(of, forces, half_, known_);
    for (int i = 0; i < n(); ++i) stopped_by_[i] += sign * known_[i];
  };
  add_response(root, 1);
  add_response(observer.root(), -1);
}

void Mover::push(const Numbers& impulse) {
  dense::respond(root, impulse, half_, known_);
  for (int i = 0; i < n(); ++i) change[i] += known_[i];
}

}  // namespace bt
