#include "bodies/response_observer.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "math/rounding.h"

namespace bt {

namespace {

// Smallest relative change of the forces from which the observer learns, smallest error of the prediction
// relative to the acceleration by gravity, motion and stops, and by the forces at joint limits, and smallest
// reduction of the response [-]: rounding and noise.
constexpr double kLeastNews = 1e-3;
// Smallest evidence of a changed response [-]: the error of the prediction as a share of the free response to
// the change of the forces (of a held body that is released, to the forces), and, for an increased response
// and for joints, the relative change of the forces. Larger: released light bodies are thrown. Smaller: steps
// of held bodies are solved twice.
constexpr double kEvidence = 0.1;
// A hold is trusted with what it has withstood, and with what would give a rate of this share of kMostRate if
// it yielded [-]. Larger: pybullet cuts off the rate of what yields, which then tells nothing about its
// force. Smaller: bodies that are held are predicted to yield where their load grows.
constexpr double kTrusted = 0.5;
// Response of a joint, as a share of that with all other joints held, below which its own motor holds it [-].
constexpr double kLeastOfJoint = 0.5;

}  // namespace

using namespace dense;

void Observer::start(int n) {
  *this = Observer{};
  n_ = n;
  set_free();
  forces_.assign(n, 0.0);
  applied_.assign(n, 0.0);
}

void Observer::observe(const Numbers& rates, const Numbers& free, const Numbers& gravity,
                       const Circumstances& of) {
  if (n_ != static_cast<int>(rates.size())) start(static_cast<int>(rates.size()));
  if (std::exchange(jointed_, of.jointed) != of.jointed) set_free();
  released_ = false;
  missed_.clear();
  if (has_acted()) {
    const Numbers& reached = sampled_.empty() ? rates : sampled_;
    measure(reached, gravity);
    compare(now_);
    now_.cut.assign(n_, 0.0);
    now_.motors = of.motors;
    now_.motors.resize(n_);
    const bool cut = (of.jointed || of.alone) && note_cut(reached);
    if (!of.jointed) leave_out_cut();
    now_.root_acceleration = now_.acceleration;
    forward(root_, now_.root_acceleration);
    if (!cut || of.jointed) released_ = held_ && was_released(now_);
    if (jointed_) note_aims(reached);
    end_yielding();
    if (!cut && !released_ && samples_ > 0 && !was_cut() && !of.stops_known) learn(now_, gravity, of);
    note_hold(gravity);
    if (jointed_ && held_ && samples_ > 0 && !released_) free_joints(reached);
    std::swap(previous_, last_);
    std::swap(last_, now_);
    samples_ = std::min(2, samples_ + 1);
    if (!of.stops_known) find_push();
    if (jointed_) aims_ = next_aims_;
    if (jointed_ && held_) push_to_aims(reached, gravity);
  }
  dense::root(n_, free, root_);
  of.stops_known ? set_free() : take_effective();
  refresh(rates);
}

void Observer::take_effective() {
  if (held_)
    product(n_, root_, share_root_, effective_root_);
  else
    effective_root_ = root_;
}

void Observer::refresh(const Numbers& rates) {
  rates_ = rates;
  known_ = true;
  acted_ = false;
  sampled_.clear();
}

bool Observer::sample(const Numbers& rates, const Numbers& gravity) {
  if (!held_ || !has_acted() || rates.size() != rates_.size()) return false;
  sampled_ = rates;
  measure(rates, gravity);
  compare(now_);
  return was_released(now_);
}

void Observer::measure(const Numbers& rates, const Numbers& gravity) {
  now_.forces = applied_;
  multiply_transposed(root_, applied_, now_.root_forces);
  now_.acceleration.resize(n_);
  for (int i = 0; i < n_; ++i) now_.acceleration[i] = (rates[i] - rates_[i]) / dt_ - gravity[i];
}

void Observer::act(const Numbers& tendons, const Numbers& others, double dt) {
  forces_ = applied_ = tendons;
  for (int i = 0; i < n_; ++i) applied_[i] += others[i];
  dt_ = dt;
  acted_ = true;
}

void Observer::rest(const Numbers& tendons) {
  if (n_ != static_cast<int>(tendons.size())) start(static_cast<int>(tendons.size()));
  forces_ = tendons;
  acted_ = false;
}

void Observer::set_free() {
  set_identity(n_, share_);
  set_identity(n_, share_root_);
  held_ = released_ = yields_ = false;
  withstood_.assign(n_, 0.0);
  limit_known_ = yielding_ = withstood_;
  take_effective();
  push_.assign(n_, 0.0);
}

void Observer::let_go() {
  set_free();
  forces_.assign(n_, 0.0);
  samples_ = 0;
}

// Of joints, those yielded whose motion differs from the prediction.
void Observer::release() {
  if (was_cut()) return let_go();
  find_hold(last_.forces, last_.acceleration);
  shares_.assign(holds_count(), 1.0);
  for (int i = 0; i < holds_count(); ++i) {
    const double least = yielding_[i] != 0 ? kLeastNews : kEvidence, load = std::fabs(last_.forces[i]);
    yielding_[i] = !jointed_ || inertia_of(i) * std::fabs(missed_[i]) > least * std::max(load, sizes_[i]);
    limit_known_[i] = yielding_[i] != 0 || (limit_known_[i] != 0 && sizes_[i] <= withstood_[i]);
    withstood_[i] = yielding_[i] != 0 ? sizes_[i] : std::max(withstood_[i], sizes_[i]);
  }
  let_yield(last_.forces, last_.acceleration);
}

// Sets s_ to the acceleration a - R w by what holds the body, hold_ to its generalized forces, and sizes_ to
// the size of each hold.
void Observer::find_hold(const Numbers& forces, const Numbers& acceleration) {
  respond(root_, forces, one_, other_);
  s_.resize(n_);
  for (int i = 0; i < n_; ++i) s_[i] = acceleration[i] - other_[i];
  hold_.assign(s_.begin(), s_.end());
  solve(root_, hold_);
  sizes_.assign(holds_count(), 0.0);
  if (!jointed_) {
    one_.assign(s_.begin(), s_.end());
    forward(root_, one_);
    sizes_[0] = std::sqrt(dot(one_, one_));
    return;
  }
  for (int i = 0; i < n_; ++i) sizes_[i] = std::fabs(hold_[i]);
}

double Observer::inertia_of(int coordinate) {
  other_.assign(n_, 0.0);
  other_[coordinate] = 1;
  forward(root_, other_);
  return dot(other_, other_);
}

bool Observer::holds(int coordinate) {
  const double* row = effective_root_.data() + coordinate * n_;
  return !(std::inner_product(row, row + n_, row, 0.0) > kLeastOfJoint / inertia_of(coordinate));
}

std::vector<int> Observer::held_joints() {
  std::vector<int> found;
  for (int i = 0; i < n_ && jointed_ && held_ && samples_ > 0; ++i)
    if (yielding_[i] == 0 && last_.motors[i] != 0 && holds(i)) found.push_back(i);
  return found;
}

// Sets the rows of vectors_ of these joints to an orthonormal basis of the span of L^T e_i.
void Observer::find_basis(const std::vector<int>& joints) {
  vectors_.assign(n_ * n_, 0.0);
  for (const int joint : joints) {
    double* row = vectors_.data() + joint * n_;
    std::copy_n(root_.data() + joint * n_, n_, row);
    const double whole = std::inner_product(row, row + n_, row, 0.0);
    for (const int other : joints) {
      if (other == joint) break;
      take_away(row, vectors_.data() + other * n_);
    }
    const double left = std::inner_product(row, row + n_, row, 0.0);
    const double scale = left > kLeastNews * kLeastNews * whole ? 1 / std::sqrt(left) : 0;
    for (int k = 0; k < n_; ++k) row[k] *= scale;
  }
}

// Rows of A (n n) lose what is along L^T e_i of these joints: of L, the motion is left that keeps their
// rates.
void Observer::keep_rates(const std::vector<int>& joints, Numbers& a) {
  find_basis(joints);
  for (const int joint : joints)
    for (int i = 0; i < n_; ++i) take_away(a.data() + i * n_, vectors_.data() + joint * n_);
}

// Changes the push so that these joints reach these rates from others: by L y with y in that span.
void Observer::push_held(const std::vector<int>& joints, const Numbers& wanted, const Numbers& from) {
  find_basis(joints);
  one_.assign(n_, 0.0);
  for (const int joint : joints) {
    const double *row = root_.data() + joint * n_, *unit = vectors_.data() + joint * n_;
    const double reach = std::inner_product(row, row + n_, unit, 0.0);
    const double missing = (wanted[joint] - from[joint]) / dt_ - push_[joint];
    const double more =
        reach > 0 ? (missing - std::inner_product(row, row + n_, one_.begin(), 0.0)) / reach : 0;
    for (int k = 0; k < n_; ++k) one_[k] += more * unit[k];
  }
  multiply(root_, one_, other_);
  for (int i = 0; i < n_; ++i) push_[i] += other_[i];
}

// x less its part along a unit vector.
void Observer::take_away(double* x, const double* unit) const {
  const double along = std::inner_product(x, x + n_, unit, 0.0);
  for (int k = 0; k < n_; ++k) x[k] -= along * unit[k];
}

// Lets holds yield where they give these shares of hold_. Without the tendons it has the acceleration
// a + E E^T ((share - 1) hold - w).
void Observer::let_yield(const Numbers& forces, const Numbers& acceleration) {
  held_push_ = push_;
  const std::vector<int> held = held_joints();
  effective_root_ = root_;
  keep_rates(held, effective_root_);
  s_.resize(n_);
  for (int i = 0; i < n_; ++i) {
    const int hold = jointed_ ? i : 0;
    s_[i] = (yielding_[hold] != 0 ? (shares_[hold] - 1) * hold_[i] : 0) - forces[i];
  }
  respond(effective_root_, s_, one_, push_);
  for (int i = 0; i < n_; ++i) push_[i] += acceleration[i];
  yields_ = true;
}

bool Observer::limit_hold(const Numbers& tendons, double dt) {
  if (!held_ || yields_ || static_cast<int>(tendons.size()) != n_) return false;
  respond(effective_root_, tendons, one_, e_);
  for (int i = 0; i < n_; ++i) e_[i] += push_[i];
  find_hold(tendons, e_);
  double fastest = 0;
  for (double a : s_) fastest = std::max(fastest, dt * std::fabs(a));
  shares_.assign(holds_count(), 1.0);
  bool any = false;
  for (int i = 0; i < holds_count(); ++i) {
    const double cut_off = kMostRate * (jointed_ ? inertia_of(i) / dt : sizes_[0] / fastest);
    const double trusted = limit_known_[i] != 0 ? withstood_[i] : withstood_[i] + kTrusted * cut_off;
    // No force moves what withstands a rate that pybullet cuts off.
    yielding_[i] = withstood_[i] < cut_off && sizes_[i] > trusted;
    if (yielding_[i] != 0) shares_[i] = trusted / sizes_[i];
    any |= yielding_[i] != 0;
  }
  if (any) let_yield(tendons, e_);
  return any;
}

// Notes the rates at which motors hold: those that they have reached, but where they may have been at their
// limit. There they give as much as ever of late, and their joint moved otherwise than it was predicted as
// held.
void Observer::note_aims(const Numbers& reached) {
  most_.resize(n_);
  aims_.resize(n_);
  next_aims_ = aims_;
  find_hold(now_.forces, now_.acceleration);
  for (int i = 0; i < n_; ++i) {
    const double motor = std::fabs(now_.motors[i]), load = std::max(std::fabs(now_.forces[i]), sizes_[i]);
    const bool as_held = holds(i) && inertia_of(i) * std::fabs(missed_[i]) <= kEvidence * load;
    if (samples_ == 0 || as_held || motor <= (1 - kLeastNews) * most_[i]) next_aims_[i] = reached[i];
    most_[i] = std::max(motor, (1 - kEvidence) * most_[i]);
  }
}

// Frees joints whose motors are at their limit: they give the same force as in the step before, and the joint
// does not reach its rate.
void Observer::free_joints(const Numbers& reached) {
  std::vector<int> held;
  bool any = false;
  for (const int i : held_joints()) {
    const double motor = now_.motors[i], off = inertia_of(i) * std::fabs(reached[i] - aims_[i]);
    const bool same = motor != 0 && std::fabs(motor - last_.motors[i]) <= kRoundingShare * std::fabs(motor);
    if (same && off > kLeastNews * dt_ * std::fabs(motor))
      any = true;
    else
      held.push_back(i);
  }
  if (!any) return;
  set_identity(n_, share_);
  hold_joints(held);
}

// Takes the motion from the response that changes the rates of these joints.
void Observer::hold_joints(const std::vector<int>& joints) {
  keep_rates(joints, share_);
  transpose(n_, share_);
  keep_rates(joints, share_);
  limit_share();
  held_ = is_held();
  take_effective();
}

// Motors that were at their limit go on to restore the rates at which they hold.
void Observer::push_to_aims(const Numbers& reached, const Numbers& gravity) {
  std::vector<int> joints;
  for (const int i : held_joints())
    if (aims_[i] != reached[i]) joints.push_back(i);
  if (joints.empty()) return;
  Numbers wanted(aims_);
  for (int i = 0; i < n_; ++i) wanted[i] -= dt_ * gravity[i];
  push_held(joints, wanted, reached);
}

// What yielded as it was let is free. Else the limit of its hold was too low.
void Observer::end_yielding() {
  if (!std::exchange(yields_, false)) return;
  turned_ = effective_root_;
  take_effective();
  if (released_) return;
  if (has_yielded()) {
    forward_rows(root_, n_, turned_);
    share_ = share_root_ = turned_;
    held_ = is_held();
    take_effective();
  }
  for (int i = 0; i < holds_count(); ++i)
    if (yielding_[i] != 0) limit_known_[i] = 0;
  std::fill(yielding_.begin(), yielding_.end(), 0.0);
}

// Whether the response is less than the free one.
bool Observer::is_held() const {
  double least = 1;
  for (int i = 0; i < n_; ++i) least = std::min(least, share_[i * n_ + i]);
  return least < 1 - kLeastNews;
}

// Notes what held the body in the last step, and the rates at which it did.
void Observer::note_hold(const Numbers& gravity) {
  if (held_) find_hold(now_.forces, now_.acceleration);
  for (int i = 0; i < holds_count(); ++i) {
    const bool holding = held_ && (!jointed_ || holds(i));
    const double now = holding ? sizes_[i] : 0;
    limit_known_[i] = limit_known_[i] != 0 && holding && now <= (1 + kEvidence) * withstood_[i];
    withstood_[i] = holding ? std::max(withstood_[i], now) : 0;
  }
  if (!released_) return;
  held_rates_ = rates_;
  for (int i = 0; i < n_ && jointed_; ++i)
    if (now_.motors[i] != 0) held_rates_[i] = next_aims_[i];
  for (int i = 0; i < n_; ++i) held_rates_[i] -= dt_ * gravity[i];
}

// Whether the last motion is nearer to that of the yielding body than to that of the held one.
bool Observer::has_yielded() {
  respond(effective_root_, now_.forces, one_, other_);
  one_.resize(n_);
  for (int i = 0; i < n_; ++i) {
    one_[i] = missed_[i];
    other_[i] += held_push_[i] - now_.acceleration[i] + missed_[i];
  }
  forward(root_, one_);
  forward(root_, other_);
  return dot(one_, other_) < 0.5 * dot(other_, other_);
}

// a - R_eff w.
void Observer::unexplained(const Sample& by, Numbers& rest) {
  respond(effective_root_, by.forces, one_, other_);
  rest.resize(n_);
  for (int i = 0; i < n_; ++i) rest[i] = by.acceleration[i] - other_[i];
}

void Observer::compare(const Sample& now) {
  unexplained(now, missed_);
  for (int i = 0; i < n_; ++i) missed_[i] -= push_[i];
}

// Without the cut-off, the rate would have been larger. A motion short of the prediction is replaced by the
// prediction. A motion beyond it is the least possible one.
void Observer::leave_out_cut() {
  for (int i = 0; i < n_; ++i)
    if (missed_[i] * now_.cut[i] < 0) now_.acceleration[i] -= missed_[i];
}

// Marks the rates that pybullet cut off. Returns whether there is any: then nothing is learned.
bool Observer::note_cut(const Numbers& rates) {
  for (int i = 0; i < n_; ++i)
    if (std::fabs(rates[i]) >= kCutOff * kMostRate) now_.cut[i] = rates[i] > 0 ? 1 : -1;
  return dot(now_.cut, now_.cut) > 0;
}

bool Observer::is_surprised(const Numbers& accelerations) {
  if (missed_.empty()) return false;
  one_ = missed_;
  other_ = accelerations;
  forward(root_, one_);
  forward(root_, other_);
  const double known = dot(last_.root_forces, last_.root_forces) + dot(other_, other_);
  return dot(one_, one_) > kEvidence * kEvidence * known;
}

// Whether the body moved along the forces by more than predicted. Of one that was let yield at a force that
// it was only trusted with, little more is evidence: this force was too large, and throws a light body.
bool Observer::was_released(const Sample& now) {
  bool only_trusted = false;
  for (int i = 0; i < holds_count(); ++i)
    only_trusted |= yields_ && yielding_[i] != 0 && limit_known_[i] == 0;
  const double beyond = dot(now.forces, missed_), least = only_trusted ? kLeastNews : kEvidence;
  return beyond > least * dot(now.root_forces, now.root_forces);
}

// Finds joints that their motors hold: what else acts on a joint has changed, and its motor by as much the
// other way, or so that it reached the rate at which it holds all the same. Returns whether there are any new
// ones. Motions under one load tell the response along this load alone.
bool Observer::find_held_joints(const Sample& now, const Numbers& gravity, double news, double noise) {
  find_hold(last_.forces, last_.acceleration);
  const Numbers before(hold_.begin(), hold_.end());
  find_hold(now.forces, now.acceleration);
  bool any = false;
  std::vector<int> joints;
  for (int i = 0; i < n_; ++i) {
    const bool held = held_ && holds(i);
    const double inertia = inertia_of(i), by = hold_[i] - before[i], motor = now.motors[i] - last_.motors[i];
    const double against = by - inertia * (now.acceleration[i] - last_.acceleration[i]), share = by / against;
    const double off = rates_[i] + dt_ * (now.acceleration[i] + gravity[i]) - aims_[i];
    const bool reached = inertia * std::fabs(off) < kLeastOfJoint * dt_ * std::fabs(against);
    const bool balanced = share > kLeastOfJoint && share < 1 / kLeastOfJoint;
    const bool loaded = against * against > kEvidence * kEvidence * news * inertia;
    const bool by_motor =
        std::fabs(by - motor) < kEvidence * std::fabs(by) && dt_ * std::fabs(by) > noise * inertia;
    const bool found = !held && loaded && by_motor && (reached || balanced);
    any |= found;
    if (held || found) joints.push_back(i);
  }
  if (any) hold_joints(joints);
  return any;
}

void Observer::learn(const Sample& now, const Numbers& gravity, const Circumstances& of) {
  change_.resize(n_);
  for (int i = 0; i < n_; ++i) change_[i] = now.root_forces[i] - last_.root_forces[i];
  const double whole = dot(now.root_forces, now.root_forces), news = dot(change_, change_);
  if (news <= kLeastNews * kLeastNews * whole) return;
  if (of.jointed && news > kEvidence * kEvidence * whole && find_held_joints(now, gravity, news, of.noise))
    return;
  s_.assign(change_.begin(), change_.end());
  multiply(share_, s_, e_);
  for (int i = 0; i < n_; ++i) e_[i] = now.root_acceleration[i] - last_.root_acceleration[i] - e_[i];
  multiply(root_, e_, one_);
  if (std::all_of(one_.begin(), one_.end(), [&](double error) { return dt_ * std::fabs(error) <= of.noise; }))
    return;
  const double es = dot(e_, s_), ee = dot(e_, e_);
  one_ = gravity;
  forward(root_, one_);
  // Forces at joint limits may cancel those of tendons but for a small remainder.
  multiply_transposed(root_, forces_, other_);
  for (int i = 0; i < n_; ++i) other_[i] -= now.root_forces[i];
  // A body that is held may yield by less than that.
  const double least_error = held_ ? kLeastNews : kEvidence;
  const double known = dot(one_, one_) + dot(other_, other_);
  if (ee <= least_error * least_error * news || ee <= kLeastNews * kLeastNews * known) return;
  // A response between none and the free one has an error e with |e|^2 <= |e.s|. An error that is twice that
  // has another cause.
  if (ee > 2 * std::fabs(es)) return;
  // The motion of a body that the user moves changes slightly in every step, independently of the forces. So
  // does the error of pybullet's sweeps over several stops of joints.
  if ((es > 0 || of.jointed) && news <= kEvidence * kEvidence * whole) return;
  for (int i = 0; i < n_; ++i)
    for (int j = 0; j < n_; ++j) share_[i * n_ + j] += e_[i] * e_[j] / es;
  limit_share();
  held_ = is_held();
  take_effective();
}

// Limits the eigenvalues of G to [0, 1], and computes S.
void Observer::limit_share() {
  turned_ = share_;
  eigen(n_, turned_, vectors_);
  share_root_.assign(share_.size(), 0.0);
  for (int k = 0; k < n_; ++k) {
    const double value = std::sqrt(std::min(1.0, std::max(0.0, turned_[k * n_ + k])));
    for (int i = 0; i < n_; ++i) share_root_[i * n_ + k] = value * vectors_[i * n_ + k];
  }
  product_transposed(n_, share_root_, share_root_, share_);
}

void Observer::trust_last() { unexplained(last_, push_); }

// What held it goes on to restore the rates at which it held.
void Observer::resume() {
  if (!yields_) return find_push();
  yields_ = false;
  std::fill(yielding_.begin(), yielding_.end(), 0.0);
  take_effective();
  find_push();
  if (jointed_) return push_held(held_joints(), held_rates_, rates_);
  for (int i = 0; i < n_; ++i) push_[i] = (held_rates_[i] - rates_[i]) / dt_;
}

void Observer::find_push() {
  if (samples_ < 2) return push_.assign(n_, 0.0);
  unexplained(last_, s_);
  unexplained(previous_, e_);
  for (int i = 0; i < n_; ++i) {
    const double a = s_[i], b = e_[i];
    const bool a_least = last_.cut[i] != 0, b_least = previous_.cut[i] != 0,
               smaller = std::fabs(a) < std::fabs(b);
    const bool takes_a = a_least == b_least ? smaller != a_least : b_least;
    push_[i] = a * b <= 0 ? 0 : takes_a ? a : b;
  }
}

}  // namespace bt
