#include "bodies/response_observer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "bodies/bounded_rows.h"

namespace bt {

namespace {

// A hold is trusted with what it has withstood, and with what would give a rate of this share of kMostRate if
// it yielded [-]. Larger: pybullet cuts off the rate of what yields, which then tells nothing about its
// force. Smaller: bodies that are held are predicted to yield where their load grows.
constexpr double kTrusted = 0.5;
// Largest error of the force on a joint without its motor, over what is reported, of a motor that was off
// [-].
constexpr double kStale = 0.5;
// Twice the damping of links that pybullet takes without being told, at small rates [1/s]. Larger: motors
// that were switched off count as on. Smaller: those that move jaws steadily count as off.
constexpr double kLinkDamping = 0.08;

bool is_cut_off(double rate) { return std::fabs(rate) >= kCutOff * kMostRate; }

bool any_cut_off(const Numbers& rates) { return std::any_of(rates.begin(), rates.end(), is_cut_off); }

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
  released_ = hold_.begun = false;
  missed_.clear();
  if (has_acted()) {
    const Numbers& reached = this->reached(rates);
    measure(reached, gravity, of.motors);
    compare(work_.now);
    work_.now.cut.assign(n_, 0.0);
    const bool cut = (of.jointed || of.alone) && note_cut(reached, of.thrown);
    if (!of.jointed) leave_out_cut();
    work_.now.root_acceleration = work_.now.acceleration;
    forward(root_, work_.now.root_acceleration);
    if (!of.thrown && (!cut || of.jointed)) released_ = hold_.acts && was_released(work_.now);
    end_yielding();
    if (!cut && !released_ && samples_ > 0 && !was_cut() && !of.stops_known && !of.joined)
      learn(work_.now, gravity, of);
    note_hold();
    std::swap(previous_, last_);
    std::swap(last_, work_.now);
    samples_ = std::min(2, samples_ + 1);
    if (!of.stops_known) find_push();
  }
  dense::root(n_, free, root_);
  of.stops_known ? set_free() : take_effective();
  refresh(rates);
}

void Observer::take_effective() {
  if (responds_freely())
    effective_root_ = root_;
  else
    product(n_, root_, share_root_, effective_root_);
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
  if (!hold_.acts) return false;
  measure(rates, gravity, motors);
  compare(work_.now);
  return was_released(work_.now);
}

// A motor of which the same force is reported as before was off if its joint moved as it does without it. It
// is off until another force is reported. A joint that goes on at its rate proves nothing where the force is
// no more than the damping that pybullet gives to links, which is not known here: its motor may hold it.
Numbers Observer::forces_of_motors(const Numbers& rates, const Numbers& gravity, const Reported& reported) {
  Numbers forces(reported.now);
  reported.off.resize(forces.size());
  if (!has_acted() || forces.size() != rates_.size() || forces.size() != reported.before.size())
    return forces;
  for (int i = 0; i < n_; ++i)
    if (reported.off[i] != 0) forces[i] = 0;
  measure(rates, gravity, forces);
  compare(work_.now);
  dense::solve(root_, missed_);  // generalized forces
  work_.momenta = rates;
  dense::solve(root_, work_.momenta);
  for (int i = 0; i < n_; ++i) {
    const double force = reported.now[i];
    const double damping = kLinkDamping * (1 + std::fabs(rates[i])) * std::fabs(work_.momenta[i]);
    const bool goes_on = std::fabs(rates[i] - rates_[i]) <= kSolverNoise && std::fabs(force) <= damping;
    const bool moved_without =
        is_cut_off(rates[i]) || (!goes_on && std::fabs(missed_[i] + force) < kStale * std::fabs(force));
    reported.off[i] = force == reported.before[i] && (reported.off[i] != 0 || moved_without);
    forces[i] = reported.off[i] != 0 ? 0 : force;
  }
  missed_.clear();
  return forces;
}

Numbers Observer::cut_off(const Numbers& known) {
  Numbers forces(n_);
  if (!has_acted() || static_cast<int>(known.size()) != n_) return forces;
  respond(root_, applied_, work_.one, work_.other);
  for (int i = 0; i < n_; ++i) {
    const double rate = rates_[i] + dt_ * (known[i] + work_.other[i]);
    forces[i] = (std::clamp(rate, -kMostRate, kMostRate) - rate) / dt_;
  }
  dense::solve(root_, forces);
  return forces;
}

void Observer::measure(const Numbers& rates, const Numbers& gravity, const Numbers& motors) {
  work_.now.forces = applied_;
  add(work_.now.forces, 1, motors);
  multiply_transposed(root_, work_.now.forces, work_.now.root_forces);
  work_.now.acceleration.resize(n_);
  for (int i = 0; i < n_; ++i) work_.now.acceleration[i] = (rates[i] - rates_[i]) / dt_ - gravity[i];
}

void Observer::act(const Numbers& tendons, const Numbers& others, double dt) {
  forces_ = applied_ = tendons;
  add(applied_, 1, others);
  dt_ = dt;
  acted_ = true;
}

void Observer::rest(const Numbers& tendons) {
  if (n_ != static_cast<int>(tendons.size())) start(static_cast<int>(tendons.size()));
  forces_ = tendons;
  acted_ = axes_known_ = false;
}

void Observer::turn_to(const Rot3& axes, const Numbers& free) {
  const Rot3 turn = axes * transposed(axes_);
  axes_ = axes;
  dense::root(n_, free, root_);
  take_effective();
  if (!std::exchange(axes_known_, true)) return;
  for (Numbers* v : {&forces_, &applied_, &push_, &hold_.push, &last_.forces, &last_.acceleration,
                     &previous_.forces, &previous_.acceleration}) {
    if (v->size() != 6) continue;
    const Vec3 turned = turn * Vec3{(*v)[3], (*v)[4], (*v)[5]};
    (*v)[3] = turned.x;
    (*v)[4] = turned.y;
    (*v)[5] = turned.z;
  }
  for (Sample* of : {&last_, &previous_}) {
    if (of->forces.empty()) continue;
    multiply_transposed(root_, of->forces, of->root_forces);
    of->root_acceleration = of->acceleration;
    forward(root_, of->root_acceleration);
  }
}

void Observer::set_free() {
  set_identity(n_, share_);
  set_identity(n_, share_root_);
  hold_.acts = hold_.begun = hold_.yields = hold_.limit_known = hold_.firm = released_ = false;
  hold_.withstood = 0;
  take_effective();
  push_.assign(n_, 0.0);
}

void Observer::let_go() {
  const bool began_now = hold_.begun;
  set_free();
  // Nothing held the body in the steps that this was learned from. What pushed it goes on.
  if (began_now) return find_push();
  forces_.assign(n_, 0.0);
  samples_ = 0;
}

void Observer::release() {
  if (was_cut()) return let_go();
  hold_.withstood = norm_of_hold(last_.forces, last_.acceleration);
  let_yield(1);
  hold_.limit_known = true;
}

// Sets work_.s to the acceleration a - R w by what holds the body. Returns |L^-1 s|.
double Observer::norm_of_hold(const Numbers& forces, const Numbers& acceleration) {
  unexplained(root_, forces, acceleration, work_.s);
  return std::sqrt(inverse_square(root_, work_.s, work_.one));
}

// Lets it yield where its hold gives it this share of the acceleration work_.s.
void Observer::let_yield(double share) {
  hold_.push = push_;
  push_ = work_.s;
  for (double& a : push_) a *= share;
  hold_.yields = true;
  take_effective();
}

bool Observer::limit_hold(const Numbers& tendons, double dt) {
  if (!hold_.acts || hold_.yields || static_cast<int>(tendons.size()) != n_) return false;
  respond(effective_root_, tendons, work_.one, work_.e);
  add(work_.e, 1, push_);
  const double needed = norm_of_hold(tendons, work_.e);
  double fastest = 0;
  for (double a : work_.s) fastest = std::max(fastest, dt * std::fabs(a));
  const double cut_off = kMostRate / fastest * needed;
  const double trusted = hold_.limit_known ? hold_.withstood : hold_.withstood + kTrusted * cut_off;
  // No force moves what withstands a rate that pybullet cuts off.
  if (hold_.withstood >= cut_off || !(needed > trusted)) return false;
  let_yield(trusted / needed);
  return true;
}

// A body that yielded as it was let is free. Else the limit of its hold was too low.
void Observer::end_yielding() {
  if (!std::exchange(hold_.yields, false)) return;
  take_effective();
  if (!released_ && has_yielded()) return set_free();
  hold_.limit_known = false;
}

// Notes what held the body in the last step.
void Observer::note_hold() {
  const double now = hold_.acts ? norm_of_hold(work_.now.forces, work_.now.acceleration) : 0;
  double thrown = 0;
  for (int i = 0; i < n_ && hold_.acts; ++i) thrown = std::max(thrown, dt_ * std::fabs(work_.s[i]));
  hold_.limit_known &= hold_.acts && now <= (1 + kEvidence) * hold_.withstood;
  hold_.withstood = hold_.acts ? std::max(hold_.withstood, now) : 0;
  hold_.firm = hold_.acts && (hold_.firm || thrown >= kCutOff * kMostRate);
}

// Whether the last motion is nearer to that of the yielding body than to that of the held one.
bool Observer::has_yielded() {
  respond(effective_root_, work_.now.forces, work_.one, work_.other);
  work_.one.resize(n_);
  for (int i = 0; i < n_; ++i) {
    work_.one[i] = missed_[i];
    work_.other[i] += hold_.push[i] - work_.now.acceleration[i] + missed_[i];
  }
  forward(root_, work_.one);
  forward(root_, work_.other);
  return dot(work_.one, work_.other) < 0.5 * dot(work_.other, work_.other);
}

// Sets rest to a - R w, of the response R with this root.
void Observer::unexplained(const Numbers& root, const Numbers& forces, const Numbers& acceleration,
                           Numbers& rest) {
  respond(root, forces, work_.one, work_.other);
  rest = acceleration;
  add(rest, -1, work_.other);
}

// a - R_eff w.
void Observer::unexplained(const Sample& by, Numbers& rest) {
  unexplained(effective_root_, by.forces, by.acceleration, rest);
}

void Observer::compare(const Sample& now) {
  unexplained(now, missed_);
  add(missed_, -1, push_);
}

// Without the cut-off, the rate would have been larger. A motion short of the prediction is replaced by the
// prediction. A motion beyond it is the least possible one.
void Observer::leave_out_cut() {
  for (int i = 0; i < n_; ++i)
    if (missed_[i] * work_.now.cut[i] < 0) work_.now.acceleration[i] -= missed_[i];
}

// Marks the rates that pybullet cut off. Returns whether there is any: then nothing is learned. After it has
// cut off the rate of a joint that was thrown, its motor slows it.
bool Observer::note_cut(const Numbers& rates, bool thrown) {
  for (int i = 0; i < n_; ++i) {
    const double predicted = thrown ? rates[i] - dt_ * missed_[i] : 0;
    if (is_cut_off(rates[i]) || is_cut_off(predicted)) work_.now.cut[i] = rates[i] > 0 ? 1 : -1;
  }
  return dot(work_.now.cut, work_.now.cut) > 0;
}

bool Observer::is_surprised(const Numbers& accelerations) {
  if (missed_.empty()) return false;
  const double known =
      dot(last_.root_forces, last_.root_forces) + inverse_square(root_, accelerations, work_.other);
  return inverse_square(root_, missed_, work_.one) > kEvidence * kEvidence * known;
}

// Whether the body moved along the forces by more than predicted.
bool Observer::was_released(const Sample& now) {
  return dot(now.forces, missed_) > kEvidence * dot(now.root_forces, now.root_forces);
}

void Observer::learn(const Sample& now, const Numbers& gravity, const Circumstances& of) {
  work_.s.resize(n_);
  for (int i = 0; i < n_; ++i) work_.s[i] = now.root_forces[i] - last_.root_forces[i];
  const double whole = dot(now.root_forces, now.root_forces), news = dot(work_.s, work_.s);
  if (news <= kLeastNews * kLeastNews * whole) return;
  multiply(share_, work_.s, work_.e);
  for (int i = 0; i < n_; ++i)
    work_.e[i] = now.root_acceleration[i] - last_.root_acceleration[i] - work_.e[i];
  multiply(root_, work_.e, work_.one);
  if (std::all_of(work_.one.begin(), work_.one.end(),
                  [&](double error) { return dt_ * std::fabs(error) <= of.noise; }))
    return;
  const double es = dot(work_.e, work_.s), ee = dot(work_.e, work_.e);
  // Forces at joint limits may cancel those of tendons but for a small remainder.
  multiply_transposed(root_, forces_, work_.other);
  add(work_.other, -1, now.root_forces);
  // A body that is held may yield by less than that.
  const double least_error = hold_.acts ? kLeastNews : kEvidence;
  const double known = inverse_square(root_, gravity, work_.one) + dot(work_.other, work_.other);
  if (ee <= least_error * least_error * news || ee <= kLeastNews * kLeastNews * known) return;
  // A response between none and the free one has an error e with |e|^2 <= |e.s|. An error that is twice that
  // has another cause.
  if (ee > 2 * std::fabs(es)) return;
  for (int i = 0; i < n_; ++i)
    for (int j = 0; j < n_; ++j) share_[i * n_ + j] += work_.e[i] * work_.e[j] / es;
  limit_share();
  double least = 1;
  for (int i = 0; i < n_; ++i) least = std::min(least, share_[i * n_ + i]);
  const bool held = std::exchange(hold_.acts, least < 1 - kLeastNews);
  hold_.begun = hold_.acts && !held && !any_cut_off(rates_);
  take_effective();
}

// Limits the eigenvalues of G to [0, 1], and computes S.
void Observer::limit_share() {
  work_.turned = share_;
  eigen(n_, work_.turned, work_.vectors);
  share_root_.assign(share_.size(), 0.0);
  for (int k = 0; k < n_; ++k) {
    const double value = std::sqrt(std::min(1.0, std::max(0.0, work_.turned[k * n_ + k])));
    for (int i = 0; i < n_; ++i) share_root_[i * n_ + k] = value * work_.vectors[i * n_ + k];
  }
  product_transposed(n_, share_root_, share_root_, share_);
}

void Observer::trust_last() { unexplained(last_, push_); }

void Observer::resume() {
  hold_.yields = false;
  take_effective();
  find_push();
}

void Observer::find_push() {
  if (samples_ < 2) return push_.assign(n_, 0.0);
  unexplained(last_, work_.s);
  unexplained(previous_, work_.e);
  for (int i = 0; i < n_; ++i) {
    const double a = work_.s[i], b = work_.e[i];
    const bool a_least = last_.cut[i] != 0, b_least = previous_.cut[i] != 0,
               smaller = std::fabs(a) < std::fabs(b);
    const bool takes_a = a_least == b_least ? smaller != a_least : b_least;
    push_[i] = a * b <= 0 ? 0 : takes_a ? a : b;
  }
}

}  // namespace bt
