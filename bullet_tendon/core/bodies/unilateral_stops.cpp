// Joint limits and contacts that stop a body in this step.
//
// Without stops, the forces w of the tendons would change the rates to u = rates + change + dt R w, R = E
// E^T. A stop along d adds the smallest impulse that keeps d u at or above its bound `wanted`:
//
//   D u' - wanted >= 0,   lambda >= 0,   complementary,     u' = u + R D^T lambda.
//
// Projected Gauss-Seidel finds the active stops S: before the solution with the forces of the last step,
// after it with its own forces (World::settle_stops). The solution treats S as rigid:
//
//   change += R S^T (S R S^T)^-1 missing,     E -= R S^T (S R S^T)^-1 S E.
//
// pybullet acts on a joint limit only once the joint has passed it: what tendons throw would go on beyond it
// for a whole step. A limit that the joint would pass in this step is therefore a stop as well. Its impulse
// is applied together with the wrenches of the tendons, to both links of the joint (limit_forces). A joint
// that touches its limit is moved to just behind it instead (limit_shifts), because pybullet's own stop knows
// what contacts and motors do in the step.
#include <algorithm>
#include <cmath>
#include <utility>

#include "bodies/body_response.h"
#include "math/rounding.h"

namespace bt {

namespace {

// Share of the depth behind a joint limit that pybullet corrects in a step (Bullet's erp) [-]. pybullet does
// not report it. The effect of another value is learned as a push on the body.
constexpr double kTakenBack = 0.2;
// Depth of a contact that pybullet does not correct [m], and share of the remaining depth that it corrects in
// a step [-] (the defaults of pybullet's slop and contactERP; it does not report them).
constexpr double kContactSlop = 1e-5;
constexpr double kContactTakenBack = 0.08;

// Maximum number of Gauss-Seidel sweeps over the stops of a body, and change of a rate, as a share of the
// rates involved, below which the sweeps end [-]. Fewer: wrong active stops if there are many.
constexpr int kStopSweeps = 100;
constexpr double kStopSettled = 1e-11;

// A stop exists if it corrected at least this share of the missing rate [-].
constexpr double kLeastStopped = 0.5;

// Depth from which pybullet's rate at a limit does not correct depth (its split impulse) [rad], [m].
constexpr double kDeepBehind = 0.04;

// Depth to which a joint is taken that would pass its limit: from then on pybullet acts [rad], [m].
constexpr double kReached = 1e-6;
// Way to the limit below which a joint touches it [rad], [m]. Larger: joints are moved visibly. Smaller: the
// noise of pybullet's contacts lifts a joint that rests on its limit, and limit_forces stop it again.
constexpr double kTouching = 1e-5;

// Least rate of a joint that may pass its limit in this step, and the rate that pybullet sets behind a limit:
// outwards, or 0 if the depth is large.
double rate_at_limit(double depth, double dt) {
  if (depth < 0) return (depth - kReached) / dt;
  return depth < kDeepBehind ? kTakenBack * depth / dt : 0;
}

// The same at a contact, which may be deeper by the slop.
double rate_at_contact(double distance, double dt) {
  const double room = distance + kContactSlop;
  return room > 0 ? -room / dt : -kContactTakenBack * room / dt;
}

}  // namespace

// pybullet reports limits as they were loaded, even after changeDynamics, and contacts for longer than they
// exist. A limit or contact that the body passed through is ignored.
void GeneralizedBody::doubt_stops() {
  doubted_.resize(n());
  if (contacts.empty()) slipped_ = false;
  rested_ = false;
  for (size_t k = 0; k < stops_.size(); ++k) {
    const Stop& s = stops_[k];
    if (!s.acts) continue;
    const bool went_on = rate_along(k, rates) - s.wanted < -kLeastStopped * std::fabs(s.held_back);
    if (s.coordinate < 0) rested_ = !went_on || rested_;
    if (!went_on) continue;
    stopped_by_.clear();
    (s.coordinate >= 0 ? doubted_[s.coordinate] = 1 : slipped_ = true);
  }
}

bool GeneralizedBody::is_stopped() const {
  return std::any_of(stops_.begin(), stops_.end(), [](const Stop& s) { return s.acts; });
}

bool GeneralizedBody::may_rest(Vec3 gravity) const {
  const double pushed = observer.push().empty() ? 0 : std::sqrt(dense::dot(observer.push(), observer.push()));
  return is_stopped() || slipped_ || observer.held() || observer.is_new() || norm(gravity) == 0 ||
         pushed > kLeastStopped * norm(gravity);
}

double GeneralizedBody::rate_along(size_t stop, const Numbers& of) const {
  const double* direction = &directions_[stop * of.size()];
  double sum = 0;
  for (size_t i = 0; i < of.size(); ++i) sum += direction[i] * of[i];
  return sum;
}

// Adds a stop along work_.direction, unless its response is rounding: joints yield in some directions only.
void GeneralizedBody::add_stop(double wanted, int coordinate, double ahead) {
  dense::multiply_transposed(root, work_.direction, work_.half);
  dense::multiply(free, work_.direction, work_.known);
  if (!(dense::dot(work_.half, work_.half) > kRoundingShare * dense::dot(work_.direction, work_.known)))
    return;
  const double foreseen = dense::dot(work_.direction, rates) + dense::dot(work_.direction, change);
  stops_.push_back({wanted, wanted - foreseen, 0, coordinate, false, ahead});
  directions_.insert(directions_.end(), work_.direction.begin(), work_.direction.end());
  work_.through.insert(work_.through.end(), work_.half.begin(), work_.half.end());
}

void GeneralizedBody::find_stops(double dt) {
  stops_.clear();
  directions_.clear();
  work_.through.clear();
  work_.within.clear();
  unstopped_ = change;
  pushed_.assign(n(), 0.0);
  doubted_.resize(n());
  for (size_t s = 0; s < limits.size(); s += 3) {
    const int i = static_cast<int>(limits[s]);
    const double depth = limits[s + 2];
    if (doubted_[i] != 0 || depth < -dt * kMostRate) continue;
    work_.direction.assign(n(), 0.0);
    work_.direction[i] = limits[s + 1];
    add_stop(rate_at_limit(depth, dt), i, -depth);
  }
  for (size_t c = 0; c < contacts.size() && !slipped_; c += 7) {
    work_.direction.assign(&contacts[c], &contacts[c] + 6);
    // A support on which it rests yields slowly and steadily.
    const double now = dense::dot(work_.direction, rates);
    add_stop(rested_ ? now : rate_at_contact(contacts[c + 6], dt), -1);
  }
}

// Computes lambda by projected Gauss-Seidel, starting from the last lambda.
void GeneralizedBody::find_pushes(const Numbers& forces, double dt) {
  const size_t m = stops_.size();
  if (work_.within.empty()) dense::product_transposed(n(), work_.through, work_.through, work_.within);
  dense::multiply_transposed(observer.root(), forces, work_.half);
  dense::multiply(work_.through, work_.half, work_.given);
  if (pushes_.size() != m) pushes_.assign(m, 0.0);
  bool settled = false;
  for (int sweep = 0; sweep < kStopSweeps && !settled; ++sweep) {
    settled = true;
    for (size_t a = 0; a < m; ++a) {
      double left = stops_[a].missing - dt * work_.given[a];
      const double whole = std::fabs(stops_[a].missing) + std::fabs(dt * work_.given[a]);
      for (size_t b = 0; b < m; ++b) left -= work_.within[a * m + b] * pushes_[b];
      const double before = pushes_[a], own = work_.within[a * m + a];
      pushes_[a] = std::max(0.0, before + left / own);
      settled &= own * std::fabs(pushes_[a] - before) <= kStopSettled * whole;
    }
  }
}

// Determines the active stops by lambda of the complementarity problem above. Returns whether they changed.
bool GeneralizedBody::choose_stops(const Numbers& forces, double dt) {
  const size_t m = stops_.size();
  bool other = false;
  find_pushes(forces, dt);
  for (size_t a = 0; a < m; ++a) {
    Stop& s = stops_[a];
    s.held_back = s.missing - dt * work_.given[a];
    const double size = std::fabs(s.missing) + dt * std::fabs(work_.given[a]);
    // It acts if it changes the rate by more than rounding.
    const bool acts = pushes_[a] * work_.within[a * m + a] > kRoundingShare * size;
    other |= std::exchange(s.acts, acts) != acts;
  }
  return other;
}

bool GeneralizedBody::settle_stops(const Numbers& forces, double dt) {
  if (stops_.empty() || static_cast<int>(forces.size()) != n()) return false;
  if (!choose_stops(forces, dt)) return false;
  stop();
  return true;
}

// Splits what the stops do in the step, under the forces of the tendons: the acceleration by pybullet's, and
// the forces of limits ahead.
void GeneralizedBody::share_stops(double dt) {
  const size_t m = stops_.size();
  find_pushes(forces, dt);
  work_.direction.assign(n(), 0.0);
  for (size_t a = 0; a < m; ++a) {
    const Stop& s = stops_[a];
    if (!(pushes_[a] > 0)) continue;
    Numbers& sum = s.ahead > kTouching ? limit_forces : work_.direction;
    const double* along = &directions_[a * n()];
    for (int i = 0; i < n(); ++i) sum[i] += pushes_[a] / dt * along[i];
    if (s.ahead > 0 && s.ahead <= kTouching)
      limit_shifts.push_back({s.coordinate, -along[s.coordinate] * (s.ahead + kReached)});
  }
  dense::respond(observer.root(), work_.direction, work_.half, stopped_by_);
}

void GeneralizedBody::stop() {
  change = unstopped_;
  root = observer.root();
  work_.missing.clear();
  for (const Stop& s : stops_)
    if (s.acts) work_.missing.push_back(s.missing);
  if (!work_.missing.empty()) take_away();
  if (dense::dot(pushed_, pushed_) > 0) push_by(pushed_);
}

// Collects S E in work_.half and S R S^T in work_.within_acting, of the active stops.
void GeneralizedBody::gather_acting() {
  work_.half.clear();
  work_.within_acting.clear();
  const size_t m = stops_.size();
  for (size_t a = 0; a < m; ++a) {
    if (!stops_[a].acts) continue;
    work_.half.insert(work_.half.end(), work_.through.begin() + a * n(),
                      work_.through.begin() + (a + 1) * n());
    for (size_t b = 0; b < m; ++b)
      if (stops_[b].acts) work_.within_acting.push_back(work_.within[a * m + b]);
  }
}

// The active stops set the rates along them and remove their directions from the response. With S E = L W,
// L L^T = S R S^T,
//
//   change += E W^T L^-1 missing,     E -= E W^T W.
void GeneralizedBody::take_away() {
  const size_t m = work_.missing.size(), width = n();
  gather_acting();
  dense::root(static_cast<int>(m), work_.within_acting, work_.within_root);
  dense::forward(work_.within_root, work_.missing);
  dense::forward_rows(work_.within_root, n(), work_.half);
  dense::product_transposed(n(), root, work_.half, work_.along);  // E W^T
  for (size_t i = 0; i < width; ++i)
    for (size_t a = 0; a < m; ++a) change[i] += work_.along[i * m + a] * work_.missing[a];
  dense::subtract_product(n(), work_.along, work_.half, root);
}

}  // namespace bt
