#include "bodies/response_observer.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bt {

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
    if (!cut || of.jointed) released_ = may_be_released() && was_released(now_);
    if (of.jointed) note_aims(reached);
    end_yielding();
    choose_holds(of.jointed);
    if (!cut && !released_ && samples_ > 0 && !was_cut() && !of.stops_known) learn(now_, gravity, of);
    note_hold(gravity);
    if (by_joint_ && held_ && samples_ > 0 && !released_) free_joints(reached);
    std::swap(previous_, last_);
    std::swap(last_, now_);
    samples_ = std::min(2, samples_ + 1);
    if (!of.stops_known) find_push();
    if (of.jointed) holds_.aims = next_aims_;
    if (by_joint_ && held_) push_to_aims(reached, gravity);
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
  if (!may_be_released() || !has_acted() || rates.size() != rates_.size()) return false;
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
  holds_.withstood.assign(n_, 0.0);
  holds_.limit_known = holds_.yielding = holds_.withstood;
  take_effective();
  push_.assign(n_, 0.0);
}

void Observer::let_go() {
  set_free();
  forces_.assign(n_, 0.0);
  samples_ = 0;
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
    only_trusted |= yields_ && holds_.yielding[i] != 0 && holds_.limit_known[i] == 0;
  const double beyond = dot(now.forces, missed_), least = only_trusted ? kLeastNews : kEvidence;
  return beyond > least * dot(now.root_forces, now.root_forces);
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

// Whether the response is less than the free one.
bool Observer::is_held() const {
  double least = 1;
  for (int i = 0; i < n_; ++i) least = std::min(least, share_[i * n_ + i]);
  return least < 1 - kLeastNews;
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
