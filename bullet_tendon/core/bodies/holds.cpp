// What holds a body, and yields beyond a limit: motors of its joints, contacts, constraints.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "bodies/response_observer.h"
#include "math/rounding.h"

namespace bt {

namespace {

// A hold is trusted with what it has withstood, and with what would give a rate of this share of kMostRate if
// it yielded [-]. Larger: pybullet cuts off the rate of what yields, which then tells nothing about its
// force. Smaller: bodies that are held are predicted to yield where their load grows.
constexpr double kTrusted = 0.5;
// Response of a joint, as a share of that with all other joints held, below which its own motor holds it [-].
constexpr double kLeastOfJoint = 0.5;

// Whether a motor gave the same force in two steps.
bool is_same(double motor, double before) {
  return std::fabs(motor - before) <= kRoundingShare * std::fabs(motor);
}

}  // namespace

using namespace dense;

// Sets s_ to the acceleration a - R w by what holds the body, hold_ to its generalized forces, and sizes_ to
// the size of each hold.
void Observer::find_hold(const Numbers& forces, const Numbers& acceleration) {
  respond(root_, forces, one_, other_);
  s_.resize(n_);
  for (int i = 0; i < n_; ++i) s_[i] = acceleration[i] - other_[i];
  hold_.assign(s_.begin(), s_.end());
  solve(root_, hold_);
  sizes_.assign(holds_count(), 0.0);
  if (!by_joint_) {
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
  for (int i = 0; i < n_ && by_joint_ && held_ && samples_ > 0; ++i)
    if (holds_.yielding[i] == 0 && last_.motors[i] != 0 && holds(i)) found.push_back(i);
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
  holds_.push = push_;
  const std::vector<int> held = held_joints();
  effective_root_ = root_;
  keep_rates(held, effective_root_);
  s_.resize(n_);
  for (int i = 0; i < n_; ++i) {
    const int hold = by_joint_ ? i : 0;
    s_[i] = (holds_.yielding[hold] != 0 ? (shares_[hold] - 1) * hold_[i] : 0) - forces[i];
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
    const double cut_off = kMostRate * (by_joint_ ? inertia_of(i) / dt : sizes_[0] / fastest);
    const double trusted =
        holds_.limit_known[i] != 0 ? holds_.withstood[i] : holds_.withstood[i] + kTrusted * cut_off;
    // No force moves what withstands a rate that pybullet cuts off.
    holds_.yielding[i] = holds_.withstood[i] < cut_off && sizes_[i] > trusted;
    if (holds_.yielding[i] != 0) shares_[i] = trusted / sizes_[i];
    any |= holds_.yielding[i] != 0;
  }
  if (any) let_yield(tendons, e_);
  return any;
}

// Of joints, those yielded whose motion differs from the prediction.
void Observer::release() {
  if (was_cut()) return let_go();
  find_hold(last_.forces, last_.acceleration);
  shares_.assign(holds_count(), 1.0);
  for (int i = 0; i < holds_count(); ++i) {
    const double least = holds_.yielding[i] != 0 ? kLeastNews : kEvidence, load = std::fabs(last_.forces[i]);
    holds_.yielding[i] =
        !by_joint_ || inertia_of(i) * std::fabs(missed_[i]) > least * std::max(load, sizes_[i]);
    holds_.limit_known[i] =
        holds_.yielding[i] != 0 || (holds_.limit_known[i] != 0 && sizes_[i] <= holds_.withstood[i]);
    holds_.withstood[i] = holds_.yielding[i] != 0 ? sizes_[i] : std::max(holds_.withstood[i], sizes_[i]);
  }
  let_yield(last_.forces, last_.acceleration);
}

// Notes what held the body in the last step, and the rates at which it did.
void Observer::note_hold(const Numbers& gravity) {
  if (held_) find_hold(now_.forces, now_.acceleration);
  for (int i = 0; i < holds_count(); ++i) {
    const bool holding = held_ && (!by_joint_ || holds(i));
    const double now = holding ? sizes_[i] : 0;
    holds_.limit_known[i] =
        holds_.limit_known[i] != 0 && holding && now <= (1 + kEvidence) * holds_.withstood[i];
    holds_.withstood[i] = holding ? std::max(holds_.withstood[i], now) : 0;
  }
  if (!released_) return;
  holds_.rates = rates_;
  for (int i = 0; i < n_ && by_joint_; ++i)
    if (now_.motors[i] != 0) holds_.rates[i] = next_aims_[i];
  for (int i = 0; i < n_; ++i) holds_.rates[i] -= dt_ * gravity[i];
}

// Whether the last motion is nearer to that of the yielding body than to that of the held one.
bool Observer::has_yielded() {
  respond(effective_root_, now_.forces, one_, other_);
  one_.resize(n_);
  for (int i = 0; i < n_; ++i) {
    one_[i] = missed_[i];
    other_[i] += holds_.push[i] - now_.acceleration[i] + missed_[i];
  }
  forward(root_, one_);
  forward(root_, other_);
  return dot(one_, other_) < 0.5 * dot(other_, other_);
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
    if (holds_.yielding[i] != 0) holds_.limit_known[i] = 0;
  std::fill(holds_.yielding.begin(), holds_.yielding.end(), 0.0);
}

// What held it goes on to restore the rates at which it held.
void Observer::resume() {
  if (!yields_) return find_push();
  yields_ = false;
  std::fill(holds_.yielding.begin(), holds_.yielding.end(), 0.0);
  take_effective();
  find_push();
  if (by_joint_) return push_held(held_joints(), holds_.rates, rates_);
  for (int i = 0; i < n_; ++i) push_[i] = (holds_.rates[i] - rates_[i]) / dt_;
}

bool Observer::may_be_released() const {
  if (held_ || !by_joint_ || samples_ < 2) return held_;
  for (int i = 0; i < n_; ++i)
    if (last_.motors[i] != 0 && is_same(last_.motors[i], previous_.motors[i])) return true;
  return false;
}

// Each joint has a hold of its own where motors are all that holds the body. What contacts and constraints
// give joints depends on each other.
void Observer::choose_holds(bool jointed) {
  bool by_joint = jointed;
  if (jointed) {
    find_hold(now_.forces, now_.acceleration);
    for (int i = 0; i < n_; ++i) s_[i] = hold_[i] - now_.motors[i];
    multiply_transposed(root_, s_, one_);
    multiply_transposed(root_, hold_, other_);
    const double most = std::max(dot(other_, other_), dot(now_.root_forces, now_.root_forces));
    by_joint = dot(one_, one_) <= kEvidence * kEvidence * most;
  }
  if (std::exchange(by_joint_, by_joint) == by_joint) return;
  holds_.withstood.assign(n_, 0.0);
  holds_.limit_known = holds_.yielding = holds_.withstood;
}

// Notes the rates at which motors hold: those that they have reached, but where they may have been at their
// limit. There they give as much as ever of late, and their joint moved otherwise than it was predicted as
// held.
void Observer::note_aims(const Numbers& reached) {
  holds_.greatest.resize(n_);
  holds_.aims.resize(n_);
  next_aims_ = holds_.aims;
  find_hold(now_.forces, now_.acceleration);
  for (int i = 0; i < n_; ++i) {
    const double motor = std::fabs(now_.motors[i]);
    const double load = std::max(std::fabs(now_.forces[i]), std::fabs(hold_[i]));
    const bool as_held = holds(i) && inertia_of(i) * std::fabs(missed_[i]) <= kEvidence * load;
    if (samples_ == 0 || as_held || motor <= (1 - kLeastNews) * holds_.greatest[i])
      next_aims_[i] = reached[i];
    holds_.greatest[i] = std::max(motor, (1 - kEvidence) * holds_.greatest[i]);
  }
}

// Frees joints whose motors are at their limit: they give the same force as in the step before, and the joint
// does not reach its rate.
void Observer::free_joints(const Numbers& reached) {
  std::vector<int> held;
  bool any = false;
  for (const int i : held_joints()) {
    const double motor = now_.motors[i], off = inertia_of(i) * std::fabs(reached[i] - holds_.aims[i]);
    if (motor != 0 && is_same(motor, last_.motors[i]) && off > kLeastNews * dt_ * std::fabs(motor))
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
    if (holds_.aims[i] != reached[i]) joints.push_back(i);
  if (joints.empty()) return;
  Numbers wanted(holds_.aims);
  for (int i = 0; i < n_; ++i) wanted[i] -= dt_ * gravity[i];
  push_held(joints, wanted, reached);
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
    const double off = rates_[i] + dt_ * (now.acceleration[i] + gravity[i]) - holds_.aims[i];
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

}  // namespace bt
