#include "bodies/response_observer.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bt {

namespace {

// A hold is trusted with what it has withstood, and with what would give a rate of this share of kMostRate if
// it yielded [-]. Larger: pybullet cuts off the rate of what yields, which then tells nothing about its
// force. Smaller: bodies that are held are predicted to yield where their load grows.
constexpr double kTrusted = 0.5;
// Largest error of the force on a joint without its motor, over what this tells, of a motor that was off [-].
constexpr double kStale = 0.5;

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
  released_ = false;
  missed_.clear();
  if (has_acted()) {
    const Numbers& reached = this->reached(rates);
    measure(reached, gravity, of.motors);
    compare(now_);
    now_.cut.assign(n_, 0.0);
    const bool cut = (of.jointed || of.alone) && note_cut(reached, of.thrown);
    if (!of.jointed) leave_out_cut();
    now_.root_acceleration = now_.acceleration;
    forward(root_, now_.root_acceleration);
    if (!cut || of.jointed) released_ = held_ && was_released(now_);
    end_yielding();
    if (!cut && !released_ && samples_ > 0 && !was_cut() && !of.stops_known) learn(now_, gravity, of);
    note_hold(gravity);
    std::swap(previous_, last_);
    std::swap(last_, now_);
    samples_ = std::min(2, samples_ + 1);
    if (!of.stops_known) find_push();
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

bool Observer::sample(const Numbers& rates, const Numbers& gravity, const Numbers& motors) {
  if (!has_acted() || rates.size() != rates_.size()) return false;
  sampled_ = rates;
  if (!held_) return false;
  measure(rates, gravity, motors);
  compare(now_);
  return was_released(now_);
}

// A motor that tells the same force as before was off if its joint moved as it does without it. It is off
// until another force is told. pybullet cuts off rates before its motors act: of one that held its joint all
// the same, it tells only what undid the rest.
Observer::Numbers Observer::forces_of_motors(const Numbers& rates, const Numbers& gravity, const Told& told) {
  Numbers forces(told.now);
  told.off.resize(forces.size());
  if (!has_acted() || forces.size() != rates_.size() || forces.size() != told.before.size()) return forces;
  for (int i = 0; i < n_; ++i)
    if (told.off[i] != 0) forces[i] = 0;
  measure(rates, gravity, forces);
  compare(now_);
  respond(effective_root_, forces, one_, e_);
  s_.resize(n_);
  for (int i = 0; i < n_; ++i) s_[i] = rates[i] - dt_ * (missed_[i] + e_[i]);  // without motors
  dense::solve(root_, missed_);                                                // generalized forces
  for (int i = 0; i < n_; ++i) {
    const double force = told.now[i];
    const bool cut_off = std::fabs(rates[i]) >= kCutOff * kMostRate;
    const bool moved_without = cut_off || std::fabs(missed_[i] + force) < kStale * std::fabs(force);
    told.off[i] = force == told.before[i] && (told.off[i] != 0 || moved_without);
    const bool held = std::fabs(rates[i] - told.foreseen[i]) < kEvidence * kMostRate;
    forces[i] = told.off[i] != 0 ? 0 : force;
    if (forces[i] != 0 && held && std::fabs(s_[i]) >= kMostRate) forces[i] += missed_[i];
  }
  missed_.clear();
  return forces;
}

void Observer::measure(const Numbers& rates, const Numbers& gravity, const Numbers& motors) {
  now_.forces = applied_;
  for (size_t i = 0; i < motors.size(); ++i) now_.forces[i] += motors[i];
  multiply_transposed(root_, now_.forces, now_.root_forces);
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
  held_ = released_ = yields_ = limit_known_ = false;
  withstood_ = 0;
  take_effective();
  push_.assign(n_, 0.0);
}

void Observer::let_go() {
  set_free();
  forces_.assign(n_, 0.0);
  samples_ = 0;
}

void Observer::release() {
  if (was_cut()) return let_go();
  withstood_ = norm_of_hold(last_.forces, last_.acceleration);
  let_yield(1);
  limit_known_ = true;
}

// Sets s_ to the acceleration a - R w by what holds the body. Returns |L^-1 s|.
double Observer::norm_of_hold(const Numbers& forces, const Numbers& acceleration) {
  respond(root_, forces, one_, other_);
  s_.resize(n_);
  one_.resize(n_);
  for (int i = 0; i < n_; ++i) one_[i] = s_[i] = acceleration[i] - other_[i];
  forward(root_, one_);
  return std::sqrt(dot(one_, one_));
}

// Lets it yield where its hold gives it this share of the acceleration s_.
void Observer::let_yield(double share) {
  held_push_ = push_;
  push_ = s_;
  for (double& a : push_) a *= share;
  effective_root_ = root_;
  yields_ = true;
}

bool Observer::limit_hold(const Numbers& tendons, double dt) {
  if (!held_ || yields_ || static_cast<int>(tendons.size()) != n_) return false;
  respond(effective_root_, tendons, one_, e_);
  for (int i = 0; i < n_; ++i) e_[i] += push_[i];
  const double needed = norm_of_hold(tendons, e_);
  double fastest = 0;
  for (double a : s_) fastest = std::max(fastest, dt * std::fabs(a));
  const double cut_off = kMostRate / fastest * needed;
  const double trusted = limit_known_ ? withstood_ : withstood_ + kTrusted * cut_off;
  // No force moves what withstands a rate that pybullet cuts off.
  if (withstood_ >= cut_off || !(needed > trusted)) return false;
  let_yield(trusted / needed);
  return true;
}

// A body that yielded as it was let is free. Else the limit of its hold was too low.
void Observer::end_yielding() {
  if (!std::exchange(yields_, false)) return;
  take_effective();
  if (!released_ && has_yielded()) return set_free();
  limit_known_ = false;
}

// Notes what held the body in the last step, and the rates at which it did.
void Observer::note_hold(const Numbers& gravity) {
  const double now = held_ ? norm_of_hold(now_.forces, now_.acceleration) : 0;
  limit_known_ &= held_ && now <= (1 + kEvidence) * withstood_;
  withstood_ = held_ ? std::max(withstood_, now) : 0;
  if (!released_) return;
  held_rates_ = rates_;
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

// Marks the rates that pybullet cut off. Returns whether there is any: then nothing is learned. After it has
// cut off the rate of a joint that was thrown, its motor slows it.
bool Observer::note_cut(const Numbers& rates, bool thrown) {
  for (int i = 0; i < n_; ++i) {
    const double predicted = thrown ? rates[i] - dt_ * missed_[i] : 0;
    if (std::max(std::fabs(rates[i]), std::fabs(predicted)) >= kCutOff * kMostRate)
      now_.cut[i] = rates[i] > 0 ? 1 : -1;
  }
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
  const double beyond = dot(now.forces, missed_), least = yields_ && !limit_known_ ? kLeastNews : kEvidence;
  return beyond > least * dot(now.root_forces, now.root_forces);
}

void Observer::learn(const Sample& now, const Numbers& gravity, const Circumstances& of) {
  s_.resize(n_);
  for (int i = 0; i < n_; ++i) s_[i] = now.root_forces[i] - last_.root_forces[i];
  const double whole = dot(now.root_forces, now.root_forces), news = dot(s_, s_);
  if (news <= kLeastNews * kLeastNews * whole) return;
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
  double least = 1;
  for (int i = 0; i < n_; ++i) least = std::min(least, share_[i * n_ + i]);
  held_ = least < 1 - kLeastNews;
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

// What released it goes on to restore the rates at which it held.
void Observer::resume() {
  const bool restores = std::exchange(yields_, false) && released_;
  take_effective();
  if (!restores) return find_push();
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
