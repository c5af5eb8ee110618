// Joint limits and contacts that stop a body in this step.
//
// Without stops, the forces w of the tendons would change the rates to u = rates + change + dt R w, R = E
// E^T. A stop along d adds the smallest impulse that keeps d u at or above its bound `wanted`:
//
//   D u' - wanted >= 0,   lambda >= 0,   complementary,     u' = u + R D^T lambda.
//
// Principal pivoting finds the active stops S: before the solution with the forces of the last step, after it
// with its own forces (World::settle_stops). The solution treats S as rigid:
//
//   change += R S^T (S R S^T)^-1 missing,     E -= R S^T (S R S^T)^-1 S E.
//
// pybullet acts on a joint limit only once the joint has passed it: what tendons throw would go on beyond it
// for a whole step. A limit that the joint would pass in this step is therefore a stop as well. Its impulse
// is applied together with the wrenches of the tendons, to both links of the joint (joint_forces). A joint
// that touches its limit is moved to just behind it instead (limit_shifts), because pybullet's own stop knows
// what contacts and motors do in the step. It needs joint_forces too where it falls short: pybullet cuts off
// rates before its stops act, and ends its sweeps over several stops early.
//
// The cut-off itself would leave the other joints of a chain without its reactions, and a body that turns
// less than was solved would be entered by the tendon that strikes it. A joint is therefore stopped at a rate
// below it, by joint_forces, and so is the spin of a base about each axis of the world.
#include <algorithm>
#include <cmath>
#include <numeric>
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

// Maximum number of pivots, per stop, and violation, as a share of the rates involved, that is rounding [-].
constexpr size_t kPivotsPerStop = 4;
constexpr double kStopSettled = 1e-11;

// Sweeps of pybullet's own solver (its default), forwards and backwards in turn. It also ends them when no
// rate changes by more than kSolverResidual.
constexpr int kPybulletSweeps = 50;

// A stop exists if it corrected at least this share of the missing rate [-].
constexpr double kLeastStopped = 0.5;

// Response along a contact, as a share of the free one, that the observer can tell from none [-].
constexpr double kLeastYield = 1e-3;
// Response of a joint, as a share of that with all other joints held, below which its own motor holds it [-].
constexpr double kLeastOfJoint = 0.5;

// Rate at which joints and spins are stopped, wherever they are [rad/s], [m/s]: below pybullet's own cut-off,
// which would have no reactions.
constexpr double kFastest = 0.99 * kMostRate;

// Depth from which pybullet's rate at a limit does not correct depth (its split impulse) [rad], [m].
constexpr double kDeepBehind = 0.04;

// Depth to which a joint is taken that would pass its limit: from then on pybullet acts [rad], [m].
constexpr double kReached = 1e-6;
// Way to the limit below which a joint touches it [rad], [m]. Larger: joints are moved visibly. Smaller: the
// noise of pybullet's contacts lifts a joint that rests on its limit, and joint_forces stop it again.
constexpr double kTouching = 1e-5;

// A row of a matrix times a vector: the rate along a stop, of the directions and rates; its change by
// impulses of all stops, of the response `within`.
double along(const dense::Numbers& rows, size_t row, const dense::Numbers& of) {
  return std::inner_product(of.begin(), of.end(), rows.begin() + row * of.size(), 0.0);
}

// Least rate of a joint that may pass its limit in this step, and the rate that pybullet sets behind a limit,
// or where the joint is moved behind it: outwards, or 0 if the depth is large.
double rate_at_limit(double depth, double dt) {
  if (depth < -kTouching) return (depth - kReached) / dt;
  depth = depth < 0 ? kReached : depth;
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
  stops_.doubted.resize(n());
  if (contacts.empty()) stops_.slipped = false;
  stops_.rested = false;
  for (size_t k = 0; k < stops_.all.size(); ++k) {
    const Stop& s = stops_.all[k];
    if (!s.acts) continue;
    const bool went_on = along(stops_.directions, k, rates) - s.wanted < -kLeastStopped * s.held_back;
    if (s.coordinate < 0) stops_.rested = !went_on || stops_.rested;
    if (!went_on || s.wanted == -kFastest) continue;
    stopped_by_.clear();
    (s.coordinate >= 0 ? stops_.doubted[s.coordinate] = 1 : stops_.slipped = true);
  }
}

bool GeneralizedBody::is_stopped() const {
  return std::any_of(stops_.all.begin(), stops_.all.end(), [](const Stop& s) { return s.acts; });
}

bool GeneralizedBody::may_rest(Vec3 gravity) const {
  const double pushed = observer.push().empty() ? 0 : std::sqrt(dense::dot(observer.push(), observer.push()));
  return is_stopped() || stops_.slipped || observer.held() || observer.is_new() || norm(gravity) == 0 ||
         pushed > kLeastStopped * norm(gravity);
}

// Adds a stop along work_.direction, unless a motor or a constraint holds the body there: an impulse that is
// divided by nearly no response would throw the body as soon as that yields. Whatever holds its other joints,
// the response of a joint is at least 1/M_ii = 1/|L^-1 e_i|^2.
void GeneralizedBody::add_stop(double wanted, int coordinate, double ahead) {
  dense::multiply_transposed(root, work_.direction, work_.half);
  double least = 0;
  if (coordinate >= 0) {
    work_.known.assign(work_.direction.begin(), work_.direction.end());
    dense::forward(observer.free_root(), work_.known);
    least = kLeastOfJoint / dense::dot(work_.known, work_.known);
  } else {
    dense::multiply(free, work_.direction, work_.known);
    least = kLeastYield * dense::dot(work_.direction, work_.known);
  }
  if (!(dense::dot(work_.half, work_.half) > least)) return;
  const double foreseen = dense::dot(work_.direction, rates) + dense::dot(work_.direction, change);
  stops_.all.push_back({wanted, wanted - foreseen, 0, coordinate, false, true, ahead});
  stops_.directions.insert(stops_.directions.end(), work_.direction.begin(), work_.direction.end());
  work_.through.insert(work_.through.end(), work_.half.begin(), work_.half.end());
}

void GeneralizedBody::find_stops(double dt) {
  stops_.all.clear();
  stops_.directions.clear();
  work_.through.clear();
  work_.within.clear();
  stops_.unstopped = change;
  stops_.doubted.resize(n());
  for (size_t s = 0; s < limits.size(); s += 3) {
    const int i = static_cast<int>(limits[s]);
    const double depth = limits[s + 2];
    const double wanted = stops_.doubted[i] != 0 ? -kFastest : std::max(-kFastest, rate_at_limit(depth, dt));
    work_.direction.assign(n(), 0.0);
    work_.direction[i] = limits[s + 1];
    add_stop(wanted, i, wanted > -kFastest ? -depth : kFastest);
  }
  for (size_t c = 0; c < contacts.size() && contacts_stop(); c += 7) {
    work_.direction.assign(&contacts[c], &contacts[c] + 6);
    // A support on which it rests yields slowly and steadily.
    const double now = dense::dot(work_.direction, rates);
    add_stop(stops_.rested ? now : rate_at_contact(contacts[c + 6], dt), -1);
  }
  for (int i = 3; i < base(); ++i)
    for (double side : {1, -1}) {
      work_.direction.assign(n(), 0.0);
      work_.direction[i] = side;
      add_stop(-kFastest, i, kFastest);
    }
}

// Computes lambda, starting from the stops of the last lambda.
void GeneralizedBody::find_pushes(const Numbers& forces, double dt) {
  const size_t m = stops_.all.size();
  if (work_.within.empty()) dense::product_transposed(n(), work_.through, work_.through, work_.within);
  dense::multiply_transposed(observer.root(), forces, work_.half);
  dense::multiply(work_.through, work_.half, work_.given);
  work_.left.resize(m);
  work_.whole.resize(m);
  for (size_t a = 0; a < m; ++a) {
    work_.left[a] = stops_.all[a].missing - dt * work_.given[a];
    work_.whole[a] = std::fabs(stops_.all[a].missing) + std::fabs(dt * work_.given[a]);
  }
  if (stops_.pushes.size() != m) stops_.pushes.assign(m, 0.0);
  pivot_stops();
}

// Principal pivoting (Murty 1974): one stop, the first that pulls or is violated, changes sides at a time.
// Where the response to the stops is singular this can go in circles; then lambda stays the last one.
void GeneralizedBody::pivot_stops() {
  const size_t m = stops_.all.size();
  std::vector<char> acts(m);
  for (size_t a = 0; a < m; ++a) acts[a] = stops_.pushes[a] > 0;
  for (size_t pivot = 0; pivot < kPivotsPerStop * m; ++pivot) {
    std::vector<size_t> acting;
    for (size_t a = 0; a < m; ++a)
      if (acts[a]) acting.push_back(a);
    Numbers within, pushes;
    for (size_t a : acting) {
      pushes.push_back(work_.left[a]);
      for (size_t b : acting) within.push_back(work_.within[a * m + b]);
    }
    dense::root(static_cast<int>(acting.size()), within, work_.within_root);
    dense::solve(work_.within_root, pushes);
    Numbers all(m);
    for (size_t k = 0; k < acting.size(); ++k) all[acting[k]] = pushes[k];
    size_t wrong = m;
    for (size_t a = 0; a < m && wrong == m; ++a) {
      const bool violated = work_.left[a] - along(work_.within, a, all) > kStopSettled * work_.whole[a];
      if (acts[a] ? all[a] < 0 : stops_.all[a].admitted && violated) wrong = a;
    }
    if (wrong == m) {
      stops_.pushes = all;
      return;
    }
    acts[wrong] ^= 1;
  }
}

// One sweep of projected Gauss-Seidel over the stops. Returns the largest change of a rate [m/s], [rad/s].
double GeneralizedBody::sweep_stops(Numbers& pushes, bool backwards) const {
  const size_t m = stops_.all.size();
  double most = 0;
  for (size_t k = 0; k < m; ++k) {
    const size_t a = backwards ? m - 1 - k : k;
    const double left = work_.left[a] - along(work_.within, a, pushes);
    const double before = pushes[a], own = work_.within[a * m + a];
    pushes[a] = stops_.all[a].admitted ? std::max(0.0, before + left / own) : 0.0;
    most = std::max(most, own * std::fabs(pushes[a] - before));
  }
  return most;
}

// The rates with this response and change of the rates, under the forces in work_.direction.
const GeneralizedBody::Numbers& GeneralizedBody::rates_with(const Numbers& by_root, const Numbers& by_change,
                                                            double dt) {
  dense::respond(by_root, work_.direction, work_.half, work_.known);
  for (int i = 0; i < n(); ++i) work_.known[i] = rates[i] + by_change[i] + dt * work_.known[i];
  return work_.known;
}

// A stop of speed begins to act only where the rates of this solution exceed it. Forces on a joint that was
// stopped would move it, free, by far more than they last: one that was dropped is not tried again, because
// no set of stops may agree with forces that change with the rotation. What is faster already has a higher
// cut-off (changeDynamics). Returns whether any stop may act.
bool GeneralizedBody::admit_stops(const Numbers& forces, double dt) {
  work_.direction = forces;
  const Numbers& reached = rates_with(root, change, dt);
  bool any = false;
  for (size_t a = 0; a < stops_.all.size(); ++a) {
    Stop& s = stops_.all[a];
    s.admitted = s.wanted > -kFastest || s.acts ||
                 (!s.dropped && along(stops_.directions, a, reached) < -kFastest &&
                  along(stops_.directions, a, rates) >= -kMostRate);
    any |= s.admitted;
  }
  return any;
}

// Determines the active stops by lambda of the complementarity problem above. Returns whether they changed.
bool GeneralizedBody::choose_stops(const Numbers& forces, double dt) {
  const size_t m = stops_.all.size();
  bool other = false;
  if (!admit_stops(forces, dt)) return false;
  find_pushes(forces, dt);
  for (size_t a = 0; a < m; ++a) {
    Stop& s = stops_.all[a];
    s.held_back = stops_.pushes[a] * work_.within[a * m + a];
    // It acts if it changes the rate by more than rounding.
    const bool acts = s.held_back > kRoundingShare * work_.whole[a];
    s.dropped |= s.acts && !acts;
    other |= std::exchange(s.acts, acts) != acts;
  }
  return other;
}

bool GeneralizedBody::settle_stops(const Numbers& forces, double dt) {
  if (stops_.all.empty() || static_cast<int>(forces.size()) != n()) return false;
  if (!choose_stops(forces, dt)) return false;
  stop();
  return true;
}

// Whether pybullet's own stops would not stop the joints, under the tendons and the limits ahead: it would
// cut off a rate before they act, or end its sweeps over them too early.
bool GeneralizedBody::pybullet_falls_short(double dt) {
  work_.direction = forces;
  for (int i = 0; i < n(); ++i) work_.direction[i] += joint_forces[i];
  for (double rate : rates_with(observer.root(), stops_.unstopped, dt))
    if (std::fabs(rate) >= kMostRate) return true;
  const size_t m = stops_.all.size();
  Numbers pushes(m);
  double change = kMostRate;
  for (int sweep = 0; sweep < kPybulletSweeps && change > kSolverResidual; ++sweep)
    change = sweep_stops(pushes, sweep % 2 == 0);
  for (size_t a = 0; a < m; ++a) pushes[a] -= stops_.pushes[a];
  for (size_t a = 0; a < m; ++a)
    if (std::fabs(along(work_.within, a, pushes)) > kSolverNoise) return true;
  return false;
}

// Splits what the stops do in the step, under the forces of the tendons: the acceleration by pybullet's, and
// the forces of limits ahead.
void GeneralizedBody::share_stops(double dt) {
  find_pushes(forces, dt);
  const auto add = [&](bool ahead, Numbers& sum) {
    for (size_t a = 0; a < stops_.all.size(); ++a)
      if ((stops_.all[a].ahead > kTouching) == ahead)
        for (int i = 0; i < n(); ++i) sum[i] += stops_.pushes[a] / dt * stops_.directions[a * n() + i];
  };
  add(true, joint_forces);
  const bool all = !limits.empty() && !observer.held() && pybullet_falls_short(dt);
  work_.direction.assign(n(), 0.0);
  add(false, all ? joint_forces : work_.direction);
  dense::respond(observer.root(), work_.direction, work_.half, stopped_by_);
  for (size_t a = 0; a < stops_.all.size(); ++a)
    if (const Stop& s = stops_.all[a]; stops_.pushes[a] > 0 && s.ahead > 0 && s.ahead <= kTouching)
      limit_shifts.push_back(
          {s.coordinate, -stops_.directions[a * n() + s.coordinate] * (s.ahead + kReached)});
}

void GeneralizedBody::stop() {
  change = stops_.unstopped;
  root = observer.root();
  work_.missing.clear();
  for (const Stop& s : stops_.all)
    if (s.acts) work_.missing.push_back(s.missing);
  if (!work_.missing.empty()) take_away();
}

// Collects S E in work_.half and S R S^T in work_.within_acting, of the active stops.
void GeneralizedBody::gather_acting() {
  work_.half.clear();
  work_.within_acting.clear();
  const size_t m = stops_.all.size();
  for (size_t a = 0; a < m; ++a) {
    if (!stops_.all[a].acts) continue;
    work_.half.insert(work_.half.end(), work_.through.begin() + a * n(),
                      work_.through.begin() + (a + 1) * n());
    for (size_t b = 0; b < m; ++b)
      if (stops_.all[b].acts) work_.within_acting.push_back(work_.within[a * m + b]);
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
