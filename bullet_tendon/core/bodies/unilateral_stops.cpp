// Joint limits and contacts that stop a body in this step, and motors that set rates of its joints.
//
// Without stops, the forces w of the tendons would change the rates to u = rates + change + dt R w, R = E
// E^T. A stop along d adds the smallest impulse that keeps d u at or above its bound `wanted`:
//
//   D u' - wanted >= 0,   lambda >= 0,   complementary,     u' = u + R D^T lambda.
//
// A motor holds its joint at a rate, D u' = wanted, by a lambda within +-dt times its limit. At a bound of
// lambda the joint is short of that rate (bodies/joint_motors.h).
//
// Principal pivoting finds the active stops S: before the solution with the forces of the last step, after it
// with its own forces (World::settle_stops). The solution treats S as rigid:
//
//   change += R S^T (S R S^T)^-1 missing,     E -= R S^T (S R S^T)^-1 S E,
//
// and motors at their limit as known forces.
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

// pybullet does not solve the motors of a body if its sweeps leave more than this share of the rates that
// they correct [-], and more than this rate [m/s], [rad/s].
constexpr double kNotSolved = 0.1;
constexpr double kNotSolvedRate = 10 * kSolverNoise;

// A stop exists if it corrected at least this share of the missing rate [-].
constexpr double kLeastStopped = 0.5;

// Response along a contact, as a share of the free one, that the observer can tell from none [-].
constexpr double kLeastYield = 1e-3;
// Response of a joint, as a share of that with all other joints held, below which contacts or constraints
// hold it [-].
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
    if (!s.acts || s.motor) continue;
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

bool GeneralizedBody::limits_act() const {
  return std::any_of(stops_.all.begin(), stops_.all.end(), [](const Stop& s) { return s.acts && !s.motor; });
}

bool GeneralizedBody::may_rest(Vec3 gravity) const {
  const double pushed = observer.push().empty() ? 0 : std::sqrt(dense::dot(observer.push(), observer.push()));
  return is_stopped() || stops_.slipped || observer.held() || observer.is_new() || norm(gravity) == 0 ||
         pushed > kLeastStopped * norm(gravity);
}

// Whether contacts or constraints hold the body along work_.direction: an impulse that is divided by nearly
// no response would throw it as soon as they yield. Sets work_.half to E^T d. Whatever holds its other
// joints, the response of a joint is at least 1/M_ii = 1/|L^-1 e_i|^2.
bool GeneralizedBody::is_held(int coordinate) {
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
  return !(dense::dot(work_.half, work_.half) > least);
}

// Adds a row along work_.direction, with E^T d in work_.half.
void GeneralizedBody::add_row(const Stop& stop) {
  stops_.all.push_back(stop);
  Stop& s = stops_.all.back();
  s.missing = s.wanted - dense::dot(work_.direction, rates) - dense::dot(work_.direction, change);
  stops_.directions.insert(stops_.directions.end(), work_.direction.begin(), work_.direction.end());
  work_.through.insert(work_.through.end(), work_.half.begin(), work_.half.end());
}

void GeneralizedBody::add_stop(double wanted, int coordinate, double ahead) {
  if (is_held(coordinate)) return;
  Stop s;
  s.wanted = wanted;
  s.coordinate = coordinate;
  s.ahead = ahead;
  add_row(s);
}

double GeneralizedBody::rate_at(size_t limit, double dt) const {
  const bool doubted = stops_.doubted[static_cast<size_t>(limits[limit])] != 0;
  return doubted ? -kFastest : std::max(-kFastest, rate_at_limit(limits[limit + 2], dt));
}

// No motor takes its joint beyond a limit.
double GeneralizedBody::bounded_by_limits(int coordinate, double aim, double dt) const {
  for (size_t s = 0; s < limits.size(); s += 3)
    if (limits[s] == coordinate)
      aim = limits[s + 1] > 0 ? std::max(aim, rate_at(s, dt)) : std::min(aim, -rate_at(s, dt));
  return aim;
}

// Adds the motors. Where contacts or constraints hold a joint, its motor is taken to push as in the last
// step.
void GeneralizedBody::add_motors(double dt) {
  std::vector<int> steady;
  for (size_t i = 0; i < motors.all.size(); ++i) {
    JointMotor& m = motors.all[i];
    m.solved = false;
    m.needed = m.force;
    if (!m.known) continue;
    const int coordinate = static_cast<int>(i);
    work_.direction.assign(n(), 0.0);
    work_.direction[i] = 1;
    if (is_held(coordinate)) {
      steady.push_back(coordinate);
      continue;
    }
    m.foreseen = bounded_by_limits(coordinate, m.foreseen, dt);
    Stop s;
    s.wanted = m.foreseen;
    s.coordinate = coordinate;
    s.motor = true;
    s.least = m.lets > 0 ? m.limit : -m.limit;
    s.most = m.lets < 0 ? -m.limit : m.limit;
    s.side = m.lets != 0 ? m.lets : m.side;
    s.acts = s.side == 0;
    m.solved = true;
    add_row(s);
  }
  if (steady.empty()) return;
  work_.direction.assign(n(), 0.0);
  for (int i : steady) work_.direction[i] = motors.all[i].force;
  dense::respond(root, work_.direction, work_.half, work_.known);
  for (int i = 0; i < n(); ++i) stops_.unstopped[i] += dt * work_.known[i];
  for (size_t a = 0; a < stops_.all.size(); ++a)
    stops_.all[a].missing -= dt * along(stops_.directions, a, work_.known);
}

void GeneralizedBody::find_stops(double dt) {
  stops_.all.clear();
  stops_.directions.clear();
  work_.through.clear();
  stops_.doubted.resize(n());
  stops_.unstopped = change;
  for (size_t s = 0; s < limits.size(); s += 3) {
    const int i = static_cast<int>(limits[s]);
    const double wanted = rate_at(s, dt);
    work_.direction.assign(n(), 0.0);
    work_.direction[i] = limits[s + 1];
    add_stop(wanted, i, wanted > -kFastest ? -limits[s + 2] : kFastest);
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
  add_motors(dt);
  dense::product_transposed(n(), work_.through, work_.through, work_.within);
}

// Computes lambda, starting from the stops of the last lambda.
void GeneralizedBody::find_pushes(const Numbers& forces, double dt) {
  const size_t m = stops_.all.size();
  dense::multiply_transposed(observer.root(), forces, work_.half);
  dense::multiply(work_.through, work_.half, work_.given);
  work_.left.resize(m);
  work_.whole.resize(m);
  for (size_t a = 0; a < m; ++a) {
    work_.left[a] = stops_.all[a].missing - dt * work_.given[a];
    work_.whole[a] = std::fabs(stops_.all[a].missing) + std::fabs(dt * work_.given[a]);
  }
  if (stops_.pushes.size() != m) stops_.pushes.assign(m, 0.0);
  rows(dt).solve(stops_.pushes);
}

// The rows under the forces for which the pushes were computed.
BoundedRows GeneralizedBody::rows(double dt) const {
  return {stops_.all, work_.within, work_.left, work_.whole, dt};
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
// cut-off (changeDynamics). Returns whether any row may act.
bool GeneralizedBody::admit_stops(const Numbers& forces, double dt) {
  work_.direction = forces;
  const Numbers& reached = rates_with(root, change, dt);
  bool any = false;
  for (size_t a = 0; a < stops_.all.size(); ++a) {
    Stop& s = stops_.all[a];
    s.admitted = s.motor || s.wanted > -kFastest || s.acts ||
                 (!s.dropped && along(stops_.directions, a, reached) < -kFastest &&
                  along(stops_.directions, a, rates) >= -kMostRate);
    any |= s.admitted;
  }
  return any;
}

// Determines which motors are at their limit, with the stops that act or fewer. The forces of a solution in
// which a motor held its joint would throw this joint beyond other stops where it yields. Returns whether any
// motor has changed.
bool GeneralizedBody::choose_motors(const Numbers& forces, double dt) {
  for (Stop& s : stops_.all) s.admitted = s.motor || s.acts;
  find_pushes(forces, dt);
  for (size_t a = 0; a < stops_.all.size(); ++a)
    if (stops_.all[a].motor && rows(dt).side_of(a, stops_.pushes[a]) != stops_.all[a].side) return true;
  return false;
}

// Determines the active stops by lambda of the complementarity problem above. Returns whether they changed.
bool GeneralizedBody::choose_stops(const Numbers& forces, double dt) {
  const size_t m = stops_.all.size();
  bool other = false;
  if (!(motors.any() && choose_motors(forces, dt))) {
    if (!admit_stops(forces, dt)) return false;
    find_pushes(forces, dt);
  }
  for (size_t a = 0; a < m; ++a) {
    Stop& s = stops_.all[a];
    s.held_back = stops_.pushes[a] * work_.within[a * m + a];
    const int side = rows(dt).side_of(a, stops_.pushes[a]);
    // A stop acts if it changes the rate by more than rounding.
    const bool acts = s.motor ? side == 0 : s.held_back > kRoundingShare * work_.whole[a];
    s.dropped |= s.acts && !acts;
    s.yielded |= s.motor && s.acts && !acts;
    other |= s.motor && side != s.side;
    s.side = side;
    other |= std::exchange(s.acts, acts) != acts;
  }
  return other;
}

bool GeneralizedBody::settle_stops(const Numbers& forces, double dt) {
  if (stops_.all.empty() || static_cast<int>(forces.size()) != n()) return false;
  if (!choose_stops(forces, dt)) return false;
  stop(dt);
  return true;
}

// Whether pybullet's own stops would not stop the joints, under the tendons and the limits ahead: it would
// cut off a rate before they act, or end its sweeps, with these impulses, too early.
bool GeneralizedBody::pybullet_falls_short(const Numbers& swept, double dt) {
  work_.direction = forces;
  for (int i = 0; i < n(); ++i) work_.direction[i] += joint_forces[i];
  for (double rate : rates_with(observer.root(), stops_.unstopped, dt))
    if (std::fabs(rate) >= kMostRate) return true;
  return rows(dt).differs(stops_.pushes, swept) > kSolverNoise;
}

// Gives pybullet the impulse of a row as a known force.
void GeneralizedBody::give(size_t row, double dt) {
  stops_.all[row].given = true;
  for (int i = 0; i < n(); ++i) joint_forces[i] += stops_.pushes[row] / dt * stops_.directions[row * n() + i];
}

// The acceleration by pybullet's own stops.
void GeneralizedBody::find_stopped_by(double dt) {
  work_.direction.assign(n(), 0.0);
  for (size_t a = 0; a < stops_.all.size(); ++a)
    for (int i = 0; i < n() && !stops_.all[a].motor && !stops_.all[a].given; ++i)
      work_.direction[i] += stops_.pushes[a] / dt * stops_.directions[a * n() + i];
  dense::respond(observer.root(), work_.direction, work_.half, stopped_by_);
}

// Notes what pybullet's motors are going to do, and whether its sweeps solve them.
void GeneralizedBody::note_motors(const Numbers& swept, double dt) {
  double whole = 0;
  for (size_t a = 0; a < swept.size(); ++a) {
    const Stop& s = stops_.all[a];
    if (!s.motor) continue;
    JointMotor& m = motors.all[s.coordinate];
    m.needed = swept[a] / dt;
    m.foreseen = s.wanted;
    m.side = s.acts ? 0 : s.side;
    if (!s.acts) continue;
    m.foreseen -= rows(dt).lacks(a, swept);
    whole = std::max(whole, std::fabs(work_.left[a]));
  }
  motors.soft |=
      whole > 0 && rows(dt).differs(stops_.pushes, swept) > std::max(kNotSolved * whole, kNotSolvedRate);
}

// Splits what the stops do in the step, under the forces of the tendons: the acceleration by pybullet's, and
// the forces of limits ahead.
void GeneralizedBody::share_stops(double dt) {
  find_pushes(forces, dt);
  const size_t m = stops_.all.size();
  bool motor_acts = false;
  for (size_t a = 0; a < m; ++a) {
    const Stop& s = stops_.all[a];
    if (!s.motor && s.ahead > kTouching && stops_.pushes[a] > 0) give(a, dt);
    motor_acts |= s.motor && s.acts;
  }
  Numbers swept(stops_.pushes);
  if (is_stopped() && !limits.empty() && !observer.held()) {
    rows(dt).sweep_as_pybullet(stops_.pushes, swept);
    if (!motor_acts && pybullet_falls_short(swept, dt))
      for (size_t a = 0; a < m; ++a)
        if (stops_.all[a].acts && !stops_.all[a].given) give(a, dt);
  }
  note_motors(swept, dt);
  find_stopped_by(dt);
  for (size_t a = 0; a < stops_.all.size(); ++a)
    if (const Stop& s = stops_.all[a];
        !s.motor && stops_.pushes[a] > 0 && s.ahead > 0 && s.ahead <= kTouching)
      limit_shifts.push_back(
          {s.coordinate, -stops_.directions[a * n() + s.coordinate] * (s.ahead + kReached)});
}

void GeneralizedBody::stop(double dt) {
  change = stops_.unstopped;
  root = observer.root();
  push_by_motors(dt);
  work_.missing.clear();
  const size_t m = stops_.all.size();
  for (size_t a = 0; a < m; ++a)
    if (stops_.all[a].acts)
      work_.missing.push_back(stops_.all[a].missing - along(work_.within, a, work_.bounded));
  if (!work_.missing.empty()) take_away();
}

// Adds the impulses of the motors at their limit, and sets work_.bounded to them, by row.
void GeneralizedBody::push_by_motors(double dt) {
  const size_t m = stops_.all.size();
  work_.bounded.assign(m, 0.0);
  if (!motors.any()) return;
  work_.direction.assign(n(), 0.0);
  for (size_t a = 0; a < m; ++a) {
    const Stop& s = stops_.all[a];
    if (!s.motor || s.acts) continue;
    work_.bounded[a] = rows(dt).bound(a, s.side);
    work_.direction[s.coordinate] = work_.bounded[a];
  }
  dense::respond(root, work_.direction, work_.half, work_.known);
  for (int i = 0; i < n(); ++i) change[i] += work_.known[i];
}

bool GeneralizedBody::let_motors_yield() {
  bool any = false;
  for (const Stop& s : stops_.all) {
    if (!s.motor || s.acts || !s.yielded || motors.all[s.coordinate].lets != 0) continue;
    motors.all[s.coordinate].lets = s.side;
    any = true;
  }
  return any;
}

// Finds what pybullet's stops did in the last step, with the forces that its motors have given.
void GeneralizedBody::explain_stops(const Numbers& by_motors) {
  const size_t m = stops_.all.size(), width = n();
  if (by_motors.size() != width || !is_stopped() || stops_.directions.size() != m * width) return;
  const double dt = observer.dt();
  const BodyStops kept = stops_;
  work_.through.clear();
  for (size_t a = 0; a < m; ++a) {
    work_.direction.assign(stops_.directions.begin() + a * width,
                           stops_.directions.begin() + (a + 1) * width);
    dense::multiply_transposed(observer.root(), work_.direction, work_.half);
    work_.through.insert(work_.through.end(), work_.half.begin(), work_.half.end());
    Stop& s = stops_.all[a];
    if (s.motor) s.least = s.most = by_motors[s.coordinate];
    if (s.given) s.least = s.most = stops_.pushes[a] / dt;
  }
  dense::product_transposed(n(), work_.through, work_.through, work_.within);
  find_pushes(forces, dt);
  find_stopped_by(dt);
  stops_ = kept;
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
