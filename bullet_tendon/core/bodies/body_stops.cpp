// Joint limits and contacts that stop a body in this step, and motors and constraints that set its rates.
//
// Without stops, the forces w of the tendons would change the rates to u = rates + change + dt R w, R = E
// E^T. A stop along d adds the smallest impulse that keeps d u at or above its bound `wanted`:
//
//   D u' - wanted >= 0,   lambda >= 0,   complementary,     u' = u + R D^T lambda.
//
// A motor holds its joint at a rate, D u' = wanted, by a lambda within +-dt times its limit. At a bound of
// lambda the joint is short of that rate (bodies/joint_motors.h). So does a constraint that the user gave to
// pybullet (bodies/link_constraints.h).
//
// Principal pivoting finds the active stops S: before the solution with the forces of the last step, after it
// with its own forces (World::settle_stops). The solution treats S as rigid:
//
//   change += R S^T (S R S^T)^-1 missing,     E -= R S^T (S R S^T)^-1 S E,
//
// and motors and constraints at their limit as known forces.
//
// pybullet acts on a joint limit only once the joint has passed it: what tendons throw would go on beyond it
// for a whole step. A limit that the joint would pass in this step is therefore a stop as well. Its impulse
// is applied together with the wrenches of the tendons, to both links of the joint (joint_forces). A joint
// that touches its limit is moved to just behind it instead (shifts), because pybullet's own stop knows
// what contacts and motors do in the step, and so is a joint on its way to it where these act. pybullet needs
// joint_forces too where it falls short: it cuts off rates before its stops act, and ends its sweeps over
// several stops early. Where it touches something, what each contact bears is not determined, and
// joint_forces are as small as the cut-off allows.
//
// The cut-off itself would leave the other joints of a chain without its reactions, and a body that turns
// less than was solved would be entered by the tendon that strikes it. A joint is therefore stopped at a rate
// below it, by joint_forces, and so is the spin of a base about each axis of the world.
#include "bodies/body_stops.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "math/rounding.h"
#include "math/soa_field.h"

namespace bt {

namespace {

// Share of the depth behind a joint limit, or of the error of a constraint, that pybullet corrects in a step
// (Bullet's erp) [-]. pybullet does not report it. The effect of another value is learned as a push on the
// body.
constexpr double kTakenBack = 0.2;
// Depth of a contact that pybullet does not correct [m], and share of the remaining depth that it corrects in
// a step [-] (the defaults of pybullet's slop and contactERP; it does not report them).
constexpr double kContactSlop = 1e-5;
constexpr double kContactTakenBack = 0.08;

// pybullet does not solve the motors of a body if its sweeps leave more than this share of the rates that
// they correct [-], and more than this rate [m/s], [rad/s].
constexpr double kNotSolved = 0.1;
constexpr double kNotSolvedRate = 10 * kSolverNoise;

// Response of a contact itself, as a share of that of the bodies along it [-]. Larger: bodies sink in.
// Smaller: rounding decides which contacts of a face bear.
constexpr double kContactYield = 1e-8;
// Maximum number of times that friction is limited by the normal forces of its own evaluation, and change of
// a limit that is none, as a share of it [-].
constexpr int kFrictionRounds = 8;
constexpr double kSameLimit = 1e-3;
// Response along a contact, as a share of the free one, that the observer can tell from none [-].
constexpr double kLeastYield = 1e-3;
// Response of a joint, as a share of that with all other joints held, below which contacts or constraints
// hold it [-].
constexpr double kLeastOfJoint = 0.5;

// A motor of unknown limit is taken to yield to what would throw its joint at the rate that pybullet cuts
// off, times this [-]. If it does not yield to that, it never does. Smaller than 1: it is never known.
// Larger: what it presses on sinks deeper into it.
constexpr double kShown = 2;

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

// Whether it acts, and none of its impulse is given. What is cut off of a motor is known from its force
// (JointMotors::add_cut_off).
bool is_pending(const Stop& s) { return s.acts && !s.motor && s.given == 0; }

bool is_limit(const Stop& s) { return s.coordinate >= 0 && !s.motor; }

double largest_of(const Numbers& a) { return bt::largest_of(a.data(), static_cast<int>(a.size())); }

}  // namespace

void rates_under(const dense::Numbers& forces, const dense::Numbers& rates, const dense::Numbers& root,
                 const dense::Numbers& change, double dt, dense::Numbers& half, dense::Numbers& after) {
  dense::respond(root, forces, half, after);
  for (size_t i = 0; i < rates.size(); ++i) after[i] = rates[i] + change[i] + dt * after[i];
}

// pybullet reports limits as they were loaded, even after changeDynamics. A limit that the body passed
// through is ignored. Where its impulse was given, pybullet's own stop did not act.
void BodyStops::doubt(const Numbers& rates) {
  doubted_.resize(rates.size());
  // Of contacts together, weighted by their impulses: of those that bear a body, any may bear nothing.
  double lost = 0, kept = 0;
  for (size_t k = 0; k < all_.size(); ++k) {
    const Stop& s = all_[k];
    if (!s.acts || s.sets_rate()) continue;
    if (s.coordinate < 0) {
      if (pushes_.size() != all_.size()) continue;  // of a crafted snapshot
      const double rate = along(directions_, k, rates);
      lost += pushes_[k] * (s.wanted - rate);
      kept += pushes_[k] * (rate - s.unstopped);
      continue;
    }
    const bool went_on = along(directions_, k, rates) - s.wanted < -kLeastStopped * s.held_back;
    if (!went_on || s.given > 0 || s.wanted == -kFastest) continue;
    by_pybullet_.clear();
    doubted_[s.coordinate] = 1;
  }
  rested_ = kept > lost;
}

bool BodyStops::broke(const Numbers& reached) const {
  double held = 0, free = 0;
  for (size_t k = 0; k < all_.size(); ++k) {
    const Stop& s = all_[k];
    if (s.constraint < 0 || !s.acts || s.given > 0) continue;
    const double rate = along(directions_, k, reached);
    held += (rate - s.wanted) * (rate - s.wanted);
    free += (rate - s.unstopped) * (rate - s.unstopped);
  }
  return held > kSolverNoise * kSolverNoise && free < kLeastStopped * kLeastStopped * held;
}

void BodyStops::watch_constraints(const Numbers& reached, double dt) {
  broke_ = broke(reached);
  yielded_ = !broke_ && yielded(dt);
  ignored_ |= broke_;
  bool kept = true;
  for (size_t k = 0; k < all_.size(); ++k)
    kept &=
        all_[k].constraint < 0 || std::fabs(along(directions_, k, reached) - all_[k].wanted) <= kSolverNoise;
  ignored_ &= !kept;
}

// Whether any row was taken to give more than its limit, as it is known after the step.
bool BodyStops::yielded(double dt) const {
  bool any = false;
  for (size_t k = 0; k < std::min(all_.size(), pushes_.size()); ++k) {
    const Stop& s = all_[k];
    if (s.constraint < 0 || s.constraint >= static_cast<int>(constraints.size()) || !s.acts) continue;
    any |= std::fabs(pushes_[k]) / dt > (1 + kLeastNews) * constraints[s.constraint].most;
  }
  return any;
}

void BodyStops::correct_constraints(const BodyStops& seen) {
  ignored_ |= seen.broke_;
  if (!seen.yielded_ || constraints.size() != seen.constraints.size()) return;
  for (size_t k = 0; k < constraints.size(); ++k) constraints[k].most = seen.constraints[k].most;
}

// Whether contacts or constraints hold the body along work_.direction: an impulse that is divided by nearly
// no response would throw it as soon as they yield. Sets work_.half to E^T d. Whatever holds its other
// joints, the response of a joint is at least 1/M_ii = 1/|L^-1 e_i|^2.
bool BodyStops::is_held(const Body& of, int coordinate) {
  dense::multiply_transposed(of.root, work_.direction, work_.half);
  double least = 0;
  if (coordinate >= 0) {
    least = kLeastOfJoint / dense::inverse_square(of.observer.free_root(), work_.direction, work_.known);
  } else {
    dense::multiply_transposed(of.observer.free_root(), work_.direction, work_.known);
    least = kLeastYield * dense::dot(work_.known, work_.known);
  }
  return !(dense::dot(work_.half, work_.half) > least);
}

// Adds a row along work_.direction, with E^T d in work_.half.
void BodyStops::add_row(const Body& of, const Stop& stop) {
  all_.push_back(stop);
  Stop& s = all_.back();
  s.missing = s.wanted - dense::dot(work_.direction, of.rates) - dense::dot(work_.direction, of.change);
  directions_.insert(directions_.end(), work_.direction.begin(), work_.direction.end());
  work_.through.insert(work_.through.end(), work_.half.begin(), work_.half.end());
}

void BodyStops::add_stop(const Body& of, double wanted, int coordinate, double ahead) {
  if (is_held(of, coordinate)) return;
  Stop s;
  s.wanted = wanted;
  s.coordinate = coordinate;
  s.ahead = ahead;
  add_row(of, s);
}

double BodyStops::rate_at(size_t limit, double dt) const {
  const bool doubted = doubted_[static_cast<size_t>(limits[limit])] != 0;
  return doubted ? -kFastest : std::max(-kFastest, rate_at_limit(limits[limit + 2], dt));
}

// No motor takes its joint beyond a limit.
double BodyStops::bounded_by_limits(int coordinate, double aim, double dt) const {
  for (size_t s = 0; s < limits.size(); s += 3)
    if (limits[s] == coordinate)
      aim = limits[s + 1] > 0 ? std::max(aim, rate_at(s, dt)) : std::min(aim, -rate_at(s, dt));
  return aim;
}

void BodyStops::find_limits(const Body& of, double dt) {
  for (size_t s = 0; s < limits.size(); s += 3) {
    const int i = static_cast<int>(limits[s]);
    const double wanted = rate_at(s, dt);
    work_.direction.assign(of.rates.size(), 0.0);
    work_.direction[i] = limits[s + 1];
    add_stop(of, wanted, i, wanted > -kFastest ? -limits[s + 2] : kFastest);
  }
}

void BodyStops::find_contacts(const Body& of, double dt) {
  const size_t n = of.rates.size();
  for (size_t c = 0; c + n + 1 < contacts.size(); c += n + 2) {
    work_.direction.assign(&contacts[c], &contacts[c] + n);
    if (is_held(of, -1)) continue;
    // A support on which it rests yields slowly and steadily.
    const double now = dense::dot(work_.direction, of.rates);
    Stop s;
    s.wanted = rested_ ? now : rate_at_contact(contacts[c + n], dt);
    s.pair = static_cast<int>(contacts[c + n + 1]);
    add_row(of, s);
  }
}

void BodyStops::find_spins(const Body& of, int base) {
  for (int i = 0; i < base; ++i)
    for (double side : {1, -1}) {
      if (i % 6 < 3) continue;  // velocity
      work_.direction.assign(of.rates.size(), 0.0);
      work_.direction[i] = side;
      add_stop(of, -kFastest, i, kFastest);
    }
}

void BodyStops::find_constraints(const Body& of, double dt) {
  for (size_t k = 0; k < constraints.size(); ++k) {
    const ConstraintRow& row = constraints[k];
    work_.direction = row.direction;
    if (is_held(of, -1)) continue;
    Stop s;
    s.wanted = -row.standing - kTakenBack * row.error / dt;
    s.constraint = static_cast<int>(k);
    s.least = ignored_ ? 0 : -row.most;
    s.most = ignored_ ? 0 : row.most;
    s.side = ignored_ ? -1 : 0;
    s.acts = !ignored_;
    add_row(of, s);
  }
}

// By the normal forces of the last step, which those of this one are like where bodies rest on each other,
// and no more than by those of this one (limit_frictions).
void BodyStops::find_frictions(const Body& of) {
  const size_t n = of.rates.size();
  for (size_t c = 0; c + n + 2 < frictions.size(); c += n + 3) {
    work_.direction.assign(&frictions[c], &frictions[c] + n);
    if (is_held(of, -1)) continue;
    Stop s;
    s.friction = s.acts = true;
    s.most = frictions[c + n];
    s.coefficient = frictions[c + n + 1];
    s.pair = static_cast<int>(frictions[c + n + 2]);
    s.least = -s.most;
    s.side = 0;
    add_row(of, s);
  }
}

// Where contacts or constraints hold a joint, or pybullet's sweeps do not solve the motors of the body, a
// motor is taken to push as in the last step.
void BodyStops::find_motors(const Body& of, double dt) {
  std::vector<int> steady;
  for (size_t i = 0; i < motors.all.size(); ++i) {
    JointMotor& m = motors.all[i];
    m.solved = false;
    m.needed = m.force;
    if (!m.known) continue;
    const int coordinate = static_cast<int>(i);
    work_.direction.assign(of.rates.size(), 0.0);
    work_.direction[i] = 1;
    if (motors.soft || is_held(of, coordinate)) {
      steady.push_back(coordinate);
      continue;
    }
    const double aim = std::exchange(m.foreseen, bounded_by_limits(coordinate, m.foreseen, dt));
    Stop s;
    // What a limit holds back, its motor does not.
    s.least = aim > m.foreseen ? 0 : -kUnlimited;
    s.most = aim < m.foreseen ? 0 : kUnlimited;
    s.wanted = m.foreseen;
    s.coordinate = coordinate;
    s.motor = true;
    s.side = m.lets != 0 ? m.lets : m.side;
    s.acts = s.side == 0;
    m.solved = true;
    add_row(of, s);
  }
  steady_ = !steady.empty();
  if (steady_) push_steadily(of, steady, dt);
}

// Takes the motors of these joints for known forces.
void BodyStops::push_steadily(const Body& of, const std::vector<int>& coordinates, double dt) {
  work_.direction.assign(of.rates.size(), 0.0);
  for (int i : coordinates) work_.direction[i] = motors.all[i].force;
  dense::respond(of.root, work_.direction, work_.half, work_.known);
  dense::add(of.change, dt, work_.known);
  for (size_t a = 0; a < all_.size(); ++a) all_[a].missing -= dt * along(directions_, a, work_.known);
}

// Sets W = D R D^T. Contacts of one face depend on each other: they yield by a little.
void BodyStops::find_within(size_t width) {
  dense::product_transposed(static_cast<int>(width), work_.through, work_.through, work_.within);
  for (size_t a = 0; a < all_.size(); ++a)
    if (all_[a].is_of_contact()) work_.within[a * all_.size() + a] *= 1 + kContactYield;
}

void BodyStops::find(const Body& of, int base, double dt) {
  all_.clear();
  directions_.clear();
  work_.through.clear();
  doubted_.resize(of.rates.size());
  motors.foresee(dt);
  find_limits(of, dt);
  find_contacts(of, dt);
  find_spins(of, base);
  find_motors(of, dt);
  find_constraints(of, dt);
  find_frictions(of);
  unstopped_ = of.change;
  find_within(of.rates.size());
  for (size_t a = 0; a < all_.size(); ++a)
    if (all_[a].motor) bound_motor(all_[a], dt * work_.within[a * all_.size() + a]);
}

// Sets the bounds of a motor's force. thrown: rate at which its joint is thrown by a force of one.
void BodyStops::bound_motor(Stop& s, double thrown) const {
  const JointMotor& m = motors.all[s.coordinate];
  const bool known = m.limit < kUnlimited;
  s.firm = !known && thrown * m.greatest >= kCutOff * kMostRate;
  const double most = known || s.firm ? m.limit : kShown * kMostRate / thrown;
  const double least = std::clamp(m.lets > 0 ? most : -most, s.least, s.most);
  s.most = std::clamp(m.lets < 0 ? -most : most, s.least, s.most);
  s.least = least;
}

// Whether it holds its joint, and may be found to yield at a limit that is not known.
bool BodyStops::may_yield(const Stop& s) const {
  return s.motor && s.acts && !s.firm && motors.all[s.coordinate].limit == kUnlimited;
}

bool BodyStops::limits_are_known() const {
  return std::none_of(all_.begin(), all_.end(), [&](const Stop& s) { return may_yield(s); });
}

bool BodyStops::hold_firmly(const Numbers& root, const Numbers& free_root) const {
  if (any_acts([](const Stop& s) { return s.motor && !s.firm; })) return false;
  return act() && largest_of(root) <= kRoundingShare * largest_of(free_root);
}

// Computes lambda, starting from the stops of the last lambda.
void BodyStops::find_pushes(const Body& of, const Numbers& forces, double dt) {
  const size_t m = all_.size();
  dense::multiply_transposed(of.observer.root(), forces, work_.half);
  dense::multiply(work_.through, work_.half, work_.given);
  work_.left.resize(m);
  work_.whole.resize(m);
  for (size_t a = 0; a < m; ++a) {
    work_.left[a] = all_[a].missing - dt * work_.given[a];
    work_.whole[a] = std::fabs(all_[a].missing) + std::fabs(dt * work_.given[a]);
  }
  if (pushes_.size() != m) pushes_.assign(m, 0.0);
  rows(dt).solve(pushes_);
}

// What lifts off in this step has no friction left, however hard it was pressed in the last one: strings
// would throw off a foot that is held by it. The limits only fall within a step: with those that rise again,
// sliding and lifting go in circles. What contacts bear between motors is not determined: jaws press as
// before.
void BodyStops::limit_frictions(double dt) {
  if (motors.any() || motors.any_reported()) return;
  for (int round = 0; round < kFrictionRounds && lower_frictions(dt); ++round) rows(dt).solve(pushes_);
}

// Returns whether any limit has fallen.
bool BodyStops::lower_frictions(double dt) {
  bool any = false;
  for (Stop& s : all_) {
    if (!s.friction) continue;
    const double most = std::min(s.most, s.coefficient * normal_force(s.pair, dt));
    any |= most < (1 - kSameLimit) * s.most;
    s.most = most;
    s.least = -most;
  }
  return any;
}

// Between two links that touch. kUnlimited: they cannot part, and their contacts are no rows (is_held).
double BodyStops::normal_force(int pair, double dt) const {
  double sum = 0;
  bool known = false;
  for (size_t a = 0; a < all_.size(); ++a) {
    if (all_[a].friction || all_[a].pair != pair) continue;
    known = true;
    sum += std::max(pushes_[a], 0.0) / dt;
  }
  return known ? sum : kUnlimited;
}

// The rows under the forces for which the pushes were computed.
BoundedRows BodyStops::rows(double dt) const { return {all_, work_.within, work_.left, work_.whole, dt}; }

// Whether a row stops what a motor that yields pushes. Such a motor pushes evenly in the whole step, but
// never takes its joint beyond its aim, which is within the limits: another force of this step holds it back.
bool BodyStops::stops_yielding_motor(size_t row) const {
  const int i = all_[row].coordinate;
  if (all_[row].motor || i < 0 || i >= static_cast<int>(motors.all.size())) return false;
  return motors.all[i].lets * directions_[row * motors.all.size() + i] < 0;
}

// A stop of speed begins to act only where the rates of this solution exceed it. What is faster already has a
// higher cut-off (changeDynamics). Returns whether any row may act.
bool BodyStops::admit(const Body& of, const Numbers& forces, double dt) {
  rates_under(forces, of.rates, of.root, of.change, dt, work_.half, work_.known);
  bool any = false;
  for (size_t a = 0; a < all_.size(); ++a) {
    Stop& s = all_[a];
    s.admitted =
        s.sets_rate() || s.wanted > -kFastest || s.acts ||
        (along(directions_, a, work_.known) < -kFastest && along(directions_, a, of.rates) >= -kMostRate);
    s.admitted &= !stops_yielding_motor(a);
    any |= s.admitted;
  }
  return any;
}

// Determines which motors are at their limit, and which joints leave theirs, with the stops that act or
// fewer. The forces of a solution in which a joint was held would throw it beyond other stops where it
// yields. Returns whether any has changed.
bool BodyStops::choose_holding(const Body& of, const Numbers& forces, double dt) {
  for (Stop& s : all_) s.admitted = s.sets_rate() || s.acts;
  find_pushes(of, forces, dt);
  for (size_t a = 0; a < all_.size(); ++a) {
    const Stop& s = all_[a];
    if (s.motor ? rows(dt).side_of(a, pushes_[a]) != s.side : is_limit(s) && s.acts && !(pushes_[a] > 0))
      return true;
  }
  return false;
}

// By lambda of the complementarity problem above.
bool BodyStops::choose(const Body& of, const Numbers& forces, double dt) {
  const size_t m = all_.size();
  bool other = false;
  const bool holds = motors.any() || any_acts(is_limit);
  if (!(holds && choose_holding(of, forces, dt))) {
    if (!admit(of, forces, dt)) return false;
    find_pushes(of, forces, dt);
  }
  limit_frictions(dt);
  for (size_t a = 0; a < m; ++a) {
    Stop& s = all_[a];
    s.held_back = pushes_[a] * work_.within[a * m + a];
    const int side = rows(dt).side_of(a, pushes_[a]);
    // A stop acts if it changes the rate by more than rounding.
    const bool acts = s.sets_rate() ? side == 0 : s.held_back > kRoundingShare * work_.whole[a];
    s.yielded |= s.motor && s.acts && !acts && rows(dt).bound(a, side) != 0;
    other |= s.sets_rate() && side != s.side;
    s.side = side;
    other |= std::exchange(s.acts, acts) != acts;
  }
  return other;
}

bool BodyStops::would_change(const Body& of, const Numbers& forces, double dt) {
  const std::vector<Stop> rows = all_;
  const Numbers pushes = pushes_;
  const bool other = choose(of, forces, dt);
  all_ = rows;
  pushes_ = pushes;
  return other;
}

// A motor at its limit that could hold its joint says nothing: stiffer contacts press more on it.
bool BodyStops::overpowered(const Body& of, const Numbers& forces, double dt) {
  if (!motors_act()) return false;
  choose_holding(of, forces, dt);
  for (size_t a = 0; a < all_.size(); ++a)
    if (all_[a].motor && all_[a].acts && rows(dt).side_of(a, pushes_[a]) != 0) return true;
  return false;
}

void BodyStops::act_on(const Body& of, double dt) {
  of.change = unstopped_;
  of.root = of.observer.root();
  push_by_bounded(of, dt);
  work_.missing.clear();
  for (size_t a = 0; a < all_.size(); ++a)
    if (all_[a].acts) work_.missing.push_back(all_[a].missing - along(work_.within, a, work_.bounded));
  if (!work_.missing.empty()) take_away(of);
}

// Adds the impulses of motors and constraints at their limit, and sets work_.bounded to them, by row.
void BodyStops::push_by_bounded(const Body& of, double dt) {
  const size_t m = all_.size(), n = of.rates.size();
  work_.bounded.assign(m, 0.0);
  work_.direction.assign(n, 0.0);
  bool any = false;
  for (size_t a = 0; a < m; ++a) {
    const Stop& s = all_[a];
    if (!s.sets_rate() || s.acts) continue;
    any = true;
    work_.bounded[a] = rows(dt).bound(a, s.side);
    for (size_t i = 0; i < n; ++i) work_.direction[i] += work_.bounded[a] * directions_[a * n + i];
  }
  if (!any) return;
  dense::respond(of.root, work_.direction, work_.half, work_.known);
  dense::add(of.change, 1, work_.known);
}

// Collects S E in work_.half and S R S^T in work_.within_acting, of the active stops.
void BodyStops::gather_acting(size_t width) {
  work_.half.clear();
  work_.within_acting.clear();
  const size_t m = all_.size();
  for (size_t a = 0; a < m; ++a) {
    if (!all_[a].acts) continue;
    work_.half.insert(work_.half.end(), work_.through.begin() + a * width,
                      work_.through.begin() + (a + 1) * width);
    for (size_t b = 0; b < m; ++b)
      if (all_[b].acts) work_.within_acting.push_back(work_.within[a * m + b]);
  }
}

// The active stops set the rates along them and remove their directions from the response. With S E = L W,
// L L^T = S R S^T,
//
//   change += E W^T L^-1 missing,     E -= E W^T W.
void BodyStops::take_away(const Body& of) {
  const size_t m = work_.missing.size(), width = of.rates.size();
  const int n = static_cast<int>(width);
  gather_acting(width);
  dense::root(static_cast<int>(m), work_.within_acting, work_.within_root);
  dense::forward(work_.within_root, work_.missing);
  dense::forward_rows(work_.within_root, n, work_.half);
  dense::product_transposed(n, of.root, work_.half, work_.along);  // E W^T
  for (size_t i = 0; i < width; ++i)
    for (size_t a = 0; a < m; ++a) of.change[i] += work_.along[i * m + a] * work_.missing[a];
  dense::subtract_product(n, work_.along, work_.half, of.root);
}

bool BodyStops::let_motors_yield() {
  bool any = false;
  for (const Stop& s : all_) {
    if (!s.motor || s.acts || !s.yielded || motors.all[s.coordinate].lets != 0) continue;
    motors.all[s.coordinate].lets = s.side;
    any = true;
  }
  return any;
}

// Sets work_.known to the rates under the tendons and what pybullet is given, before its stops act. Returns
// whether it cuts off one of them.
bool BodyStops::pybullet_cuts_off(const Body& of, const Numbers& forces, const Numbers& given, double dt) {
  work_.along = forces;
  dense::add(work_.along, 1, given);
  rates_under(work_.along, of.rates, of.observer.root(), unstopped_, dt, work_.half, work_.known);
  return std::any_of(work_.known.begin(), work_.known.end(),
                     [](double rate) { return std::fabs(rate) >= kMostRate; });
}

// The least share of the impulses of what acts, and was not given yet, with which no rate is cut off [-].
double BodyStops::share_cut_off(const Body& of, const Numbers& forces, double dt, const Numbers& given) {
  if (!pybullet_cuts_off(of, forces, given, dt)) return 0;
  const size_t n = of.rates.size();
  work_.direction.assign(n, 0.0);
  for (size_t a = 0; a < all_.size(); ++a)
    for (size_t i = 0; i < n && is_pending(all_[a]); ++i)
      work_.direction[i] += pushes_[a] * directions_[a * n + i];
  dense::respond(of.observer.root(), work_.direction, work_.half, work_.along);
  double share = 0;
  for (size_t i = 0; i < n; ++i) {
    const double rate = work_.known[i], less = rate > 0 ? -work_.along[i] : work_.along[i];
    if (std::fabs(rate) < kMostRate) continue;
    share = std::max(share, less > 0 ? (std::fabs(rate) - kFastest) / less : 1);
  }
  return std::min(share, 1.0);
}

// Gives pybullet what it would cut off. What a contact bears is not known well, and pybullet's own stops take
// nothing back. With contacts, they are therefore given as little as they can be, but for constraints, which
// take back what is too much.
void BodyStops::give_cut_off(const Body& of, const Numbers& forces, double dt, Numbers& given) {
  if (!pybullet_cuts_off(of, forces, given, dt)) return;
  for (size_t a = 0; a < all_.size(); ++a)
    if (is_pending(all_[a]) && (contacts.empty() || all_[a].constraint >= 0)) give(a, 1, dt, given);
  const double share = share_cut_off(of, forces, dt, given);
  for (size_t a = 0; a < all_.size() && share > 0; ++a)
    if (is_pending(all_[a])) give(a, share, dt, given);
}

// Gives pybullet a share of the impulse of a row as a known force.
void BodyStops::give(size_t row, double share, double dt, Numbers& given) {
  all_[row].given = share;
  const size_t n = given.size();
  for (size_t i = 0; i < n; ++i) given[i] += share * pushes_[row] / dt * directions_[row * n + i];
}

// Finds the acceleration by pybullet's own stops.
void BodyStops::find_by_pybullet(const Body& of, double dt) {
  const size_t n = of.rates.size();
  work_.direction.assign(n, 0.0);
  for (size_t a = 0; a < all_.size(); ++a)
    for (size_t i = 0; i < n && !all_[a].motor && all_[a].given < 1; ++i)
      work_.direction[i] += (1 - all_[a].given) * pushes_[a] / dt * directions_[a * n + i];
  dense::respond(of.observer.root(), work_.direction, work_.half, by_pybullet_);
}

// Notes what pybullet's motors are going to do, and whether its sweeps solve them.
void BodyStops::note_motors(const Numbers& swept, double dt) {
  double whole = 0;
  for (size_t a = 0; a < swept.size(); ++a) {
    const Stop& s = all_[a];
    if (!s.motor) continue;
    JointMotor& m = motors.all[s.coordinate];
    m.needed = swept[a] / dt;
    m.foreseen = s.wanted;
    m.side = s.acts ? 0 : s.side;
    if (!s.acts) continue;
    // pybullet cuts off faster rates before its motors act: where sweeps diverge, nothing is foreseen.
    const double left = s.wanted - rows(dt).lacks(a, swept);
    if (std::fabs(left) < kMostRate) m.foreseen = left;
    whole = std::max(whole, std::fabs(work_.left[a]));
  }
  motors.soft |= whole > 0 && rows(dt).differs(pushes_, swept) > std::max(kNotSolved * whole, kNotSolvedRate);
}

// Notes the rates that rows would have if pybullet stopped nothing.
// Of a constraint, without all constraints, and of a contact, without all contacts; motors and limits act on.
void BodyStops::note_unstopped(const Body& of, const Numbers& forces, double dt) {
  if (constraints.empty() && contacts.empty()) return;
  rates_under(forces, of.rates, of.observer.root(), unstopped_, dt, work_.half, work_.known);
  const size_t m = all_.size();
  for (size_t a = 0; a < m; ++a) {
    Stop& s = all_[a];
    if (s.constraint < 0 && !s.is_of_contact()) continue;
    s.unstopped = along(directions_, a, work_.known);
    for (size_t b = 0; b < m; ++b)
      if ((all_[b].constraint < 0) != (s.constraint < 0) || all_[b].is_of_contact() != s.is_of_contact())
        s.unstopped += work_.within[a * m + b] * pushes_[b];
  }
}

void BodyStops::rest(int n) {
  by_pybullet_.assign(n, 0.0);
  shifts.clear();
}

void BodyStops::share(const Body& of, const Numbers& forces, double dt, Numbers& given) {
  if (!act() && !motors.any()) return;
  find_pushes(of, forces, dt);
  limit_frictions(dt);
  const size_t m = all_.size(), n = of.rates.size();
  const bool answered = motors_act() || (of.observer.held() && motors.any());
  while (shift_to_limits(of, answered, dt)) find_pushes(of, forces, dt);
  note_unstopped(of, forces, dt);
  for (size_t a = 0; a < m; ++a) {
    const Stop& s = all_[a];
    const bool is_given = s.wanted > -kFastest || !(answered || steady_);
    if (!s.motor && is_given && s.ahead > 0 && pushes_[a] > 0) give(a, 1, dt, given);
  }
  Numbers swept(pushes_);
  if (act() && are_swept(static_cast<int>(n)) && !of.observer.held()) {
    rows(dt).sweep_as_pybullet(pushes_, swept);
    // pybullet ends its sweeps over several stops too early. With contacts, what each of them bears is not
    // known as well.
    if (!answered && contacts.empty() && rows(dt).differs(pushes_, swept) > kSolverNoise) {
      for (size_t a = 0; a < m; ++a)
        if (is_pending(all_[a])) give(a, 1, dt, given);
    }
    give_cut_off(of, forces, dt, given);
  }
  note_motors(swept, dt);
  find_by_pybullet(of, dt);
}

// Moves joints to just behind the limit that they would pass in this step, where pybullet's own stop acts:
// those that touch it, and, where motors answer to what the body gets (`answered`), those that their
// rates take there. How they answer is not known well enough for a force to stop a joint: too large a one
// throws it back. Returns whether there is any.
bool BodyStops::shift_to_limits(const Body& of, bool answered, double dt) {
  bool any = false;
  for (size_t a = 0; a < all_.size(); ++a) {
    Stop& s = all_[a];
    if (s.motor || !(s.ahead > 0) || !(s.wanted > -kFastest) || !(pushes_[a] > 0)) continue;
    const double carried = -dt * along(directions_, a, of.rates);
    if (s.ahead > (answered ? std::max(kTouching, carried) : kTouching)) continue;
    const double way = s.ahead + kReached, behind = rate_at_limit(kReached, dt);
    shifts.push_back(s.coordinate);
    shifts.push_back(-directions_[a * of.rates.size() + s.coordinate] * way);
    s.missing += behind - s.wanted;
    s.wanted = behind;
    s.ahead = 0;
    any = true;
  }
  return any;
}

void BodyStops::explain(const Body& of, const Numbers& forces, const Numbers& by_motors) {
  const size_t m = all_.size(), width = of.rates.size();
  const bool known = by_motors.size() == width || (by_motors.empty() && constraints_released());
  if (!known || !act() || directions_.size() != m * width) return;
  const double dt = of.observer.dt();
  const std::vector<Stop> foreseen(all_);
  const Numbers foreseen_pushes(pushes_);
  work_.through.clear();
  for (size_t a = 0; a < m; ++a) {
    work_.direction.assign(directions_.begin() + a * width, directions_.begin() + (a + 1) * width);
    dense::multiply_transposed(of.observer.root(), work_.direction, work_.half);
    work_.through.insert(work_.through.end(), work_.half.begin(), work_.half.end());
    Stop& s = all_[a];
    if (s.motor) s.least = s.most = by_motors[s.coordinate];
    if (s.given == 1 || (s.given > 0 && !s.sets_rate())) s.least = s.given * pushes_[a] / dt;
    if (s.given == 1) s.most = s.least;
    if (s.constraint >= 0 && constraints_released()) {
      const bool known = s.constraint < static_cast<int>(constraints.size());
      s.most = broke_ || !known ? 0 : std::min(s.most, constraints[s.constraint].most);
      s.least = -s.most;
    }
  }
  find_within(width);
  find_pushes(of, forces, dt);
  find_by_pybullet(of, dt);
  all_ = foreseen;
  pushes_ = foreseen_pushes;
}

}  // namespace bt
