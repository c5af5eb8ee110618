// Joint limits and contacts that stop a body in this step.
//
// Without them the tendons' forces w would take the rates to u = rates + change + dt R w, R = E E^T. A stop
// along d gives the least impulse that keeps d u from falling below the rate that it wants:
//
//   D u' - wanted >= 0,   lambda >= 0,   complementary,     u' = u + R D^T lambda.
//
// Which ones act is found with the forces at hand by projected Gauss and Seidel, before the solution by those
// of the last step and after it by its own (World::settle_stops). The solution itself takes those that act,
// S, for what does not yield:
//
//   change += R S^T (S R S^T)^-1 missing,     E -= R S^T (S R S^T)^-1 S E.
#include "bodies/unilateral_stops.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "bodies/body_response.h"

namespace bt {

namespace {

// Share of the largest eigenvalue of a response under which it is nothing [-]: joints yield in some
// directions only.
constexpr double kRank = 1e-9;

// Share of the depth behind a joint's limit that pybullet takes back in a step (Bullet's erp) [-]. It cannot
// be asked for; where it was set otherwise, that is learned as what holds the body.
constexpr double kTakenBack = 0.2;
// What a contact may be deep without being pushed apart [m], and the share of the rest that is taken back in
// a step [-] (pybullet's slop and contactERP, as it sets them; they cannot be asked for).
constexpr double kContactSlop = 1e-5;
constexpr double kContactTakenBack = 0.08;

// A limit or contact acts where what it changes is more than this share of the rates at hand [-]: rounding.
constexpr double kLeastPush = 1e-9;

// Sweeps over the limits and contacts of a body at most, to find which ones stop it, and change of a rate by
// one, as a share of those at hand, under which no more are made [-]. Fewer: wrong ones of many.
constexpr int kStopSweeps = 100;
constexpr double kStopSettled = 1e-11;

// Share of what was missing to the rate at a limit or contact that has to be made up for the limit to be
// believed [-].
constexpr double kLeastStopped = 0.5;

// Depth from which it does not (its split impulse) [rad], [m].
constexpr double kDeepBehind = 0.04;

// The rate that pybullet gives what is behind a limit: outwards, or none where it is deep.
double rate_at_limit(double depth, double dt) { return depth < kDeepBehind ? kTakenBack * depth / dt : 0; }

// And at a contact, which may be deeper than it shows by its slop.
double rate_at_contact(double distance, double dt) {
  const double room = distance + kContactSlop;
  return room > 0 ? -room / dt : -kContactTakenBack * room / dt;
}

}  // namespace

// Limits that were changed (changeDynamics) are told as they were loaded, and contacts for longer than they
// hold: what goes on through one has none.
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

// Along work_.direction.
void GeneralizedBody::add_stop(double wanted, int coordinate) {
  dense::multiply_transposed(root, work_.direction, work_.half);
  dense::multiply(free, work_.direction, work_.known);
  if (!(dense::dot(work_.half, work_.half) > kRank * dense::dot(work_.direction, work_.known))) return;
  const double foreseen = dense::dot(work_.direction, rates) + dense::dot(work_.direction, change);
  stops_.push_back({wanted, wanted - foreseen, 0, coordinate, false});
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
    if (doubted_[i] != 0) continue;
    work_.direction.assign(n(), 0.0);
    work_.direction[i] = limits[s + 1];
    add_stop(rate_at_limit(limits[s + 2], dt), i);
  }
  for (size_t c = 0; c < contacts.size() && !slipped_; c += 7) {
    work_.direction.assign(&contacts[c], &contacts[c] + 6);
    // What it rests on gives way slowly and steadily.
    const double now = dense::dot(work_.direction, rates);
    add_stop(rested_ ? now : rate_at_contact(contacts[c + 6], dt), -1);
  }
}

// Pushes that answer to what is missing, by projected Gauss and Seidel from those of the last time.
void GeneralizedBody::find_pushes(double dt) {
  const size_t m = stops_.size();
  if (pushes_.size() != m) pushes_.assign(m, 0.0);
  bool settled = false;  // but for a share of the rates at hand
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

// By lambda of the complementarity problem above; whether they are other ones.
bool GeneralizedBody::choose_stops(const Numbers& forces, double dt) {
  const size_t m = stops_.size();
  bool other = false;
  if (work_.within.empty()) dense::product_transposed(n(), work_.through, work_.through, work_.within);
  dense::multiply_transposed(observer.root(), forces, work_.half);
  dense::multiply(work_.through, work_.half, work_.given);
  find_pushes(dt);
  for (size_t a = 0; a < m; ++a) {
    Stop& s = stops_[a];
    s.held_back = s.missing - dt * work_.given[a];
    const double size = std::fabs(s.missing) + dt * std::fabs(work_.given[a]);
    const bool acts = pushes_[a] * work_.within[a * m + a] > kLeastPush * size;
    other |= std::exchange(s.acts, acts) != acts;
  }
  return other;
}

bool GeneralizedBody::settle_stops(const Numbers& forces, double dt) {
  if (stops_.empty() || static_cast<int>(forces.size()) != n()) return false;
  if (!choose_stops(forces, dt)) return false;
  stop(dt);
  return true;
}

void GeneralizedBody::stop(double dt) {
  change = unstopped_;
  root = observer.root();
  work_.missing.clear();
  for (const Stop& s : stops_)
    if (s.acts) work_.missing.push_back(s.missing);
  stopped_by_.assign(n(), 0.0);
  if (!work_.missing.empty()) take_away(dt);
  if (dense::dot(pushed_, pushed_) > 0) push_by(pushed_);
}

// S E, in work_.half, and S R S^T, of those that act.
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

// What acts keeps the rates, and takes its directions from the response: with S E = L W, L L^T = S R S^T,
//
//   change += E W^T L^-1 missing,     E -= E W^T W.
void GeneralizedBody::take_away(double dt) {
  const size_t m = work_.missing.size(), width = n();
  const double rate = 1 / dt;
  gather_acting();
  dense::root(static_cast<int>(m), work_.within_acting, work_.within_root);
  dense::forward(work_.within_root, work_.missing);
  dense::forward_rows(work_.within_root, n(), work_.half);
  dense::product_transposed(n(), root, work_.half, work_.along);  // E W^T
  for (size_t i = 0; i < width; ++i)
    for (size_t a = 0; a < m; ++a) {
      const double by = work_.along[i * m + a] * work_.missing[a];
      change[i] += by;
      stopped_by_[i] += rate * by;
    }
  dense::subtract_product(n(), work_.along, work_.half, root);
}

}  // namespace bt
