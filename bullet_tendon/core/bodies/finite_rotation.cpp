#include "bodies/finite_rotation.h"

#include <algorithm>
#include <cmath>

namespace bt {

namespace {

// Up to this angle pybullet rotates a body by spin times step, beyond it by less [rad].
constexpr double kWholeTurn = 0.78539816339744831;
// Half of the range of angles in which this sets in [rad]. At a corner, where solutions may lie, Newton's
// method finds no equilibrium. Larger: bodies turn otherwise than pybullet turns them. Smaller: more
// iterations.
constexpr double kSetsIn = 1e-3;
// Square of an angle below which A and B are evaluated by their series [rad^2].
constexpr double kSmallTurn = 1e-3;
// Largest angle of which a theta is computed [rad]. Larger: spins without bounds.
constexpr double kMostTurn = 3.1;
// Newton steps for the theta that is slowed to an angle: where slowing sets in, three end within rounding.
constexpr int kNewtonSteps = 4;

// A, B and their derivatives by t over t.
struct Series {
  double a, b, a_slope, b_slope;
};

Series series_of(double t) {
  const double s = t * t;
  if (s < kSmallTurn)
    return {0.5 - s / 24 + s * s / 720, 1.0 / 6 - s / 120 + s * s / 5040, -1.0 / 12 + s / 180,
            -1.0 / 60 + s / 1260};
  const double sine = std::sin(t), cosine = std::cos(t);
  return {(1 - cosine) / s, (t - sine) / (s * t), (t * sine - 2 + 2 * cosine) / (s * s),
          (3 * sine - 2 * t - t * cosine) / (s * s * t)};
}

// g, g'/t and (g'' - g'/t)/t^2.
struct Slowing {
  double share, slope, curve;
};

Slowing slowing_of(double t) {
  const double into = t - kWholeTurn + kSetsIn;
  if (into <= 0) return {1, 0, 0};
  // Where it sets in, the rotation is slowed as at the angle `at`. Its derivative `by` to t grows evenly from
  // 0 to 1, and `more` is that of `by`.
  const bool sets_in = into < 2 * kSetsIn;
  const double by = sets_in ? 0.5 * into / kSetsIn : 1, more = sets_in ? 0.5 / kSetsIn : 0;
  const double at = sets_in ? kWholeTurn + 0.5 * by * into : t;
  const double c = std::tan(0.5 * kWholeTurn) / kWholeTurn, d = 1 + c * c * at * at;
  const double share = 2 * std::atan(c * at) / at, slope = (2 * c / d - share) / at;
  const double curve = by * by * (-4 * c * c * c * at / (d * d) - 2 * slope) / at + more * slope;
  return {share, by * slope / t, (curve - by * slope / t) / (t * t)};
}

// The symmetric part of the outer product.
Sym3 both(Vec3 a, Vec3 b) {
  const double xy = a.x * b.y + a.y * b.x, xz = a.x * b.z + a.z * b.x, yz = a.y * b.z + a.z * b.y;
  return {a.x * b.x, 0.5 * xy, 0.5 * xz, a.y * b.y, 0.5 * yz, a.z * b.z};
}

// M^T S M
Sym3 within(const Mat3& m, const Sym3& s) {
  auto column = [&](int k) { return transposed_times(m, s * (m * unit_axis(k))); };
  return upper({column(0), column(1), column(2)});
}

Vec3 slowed(Vec3 theta) { return slowing_of(norm(theta)).share * theta; }

// A part of theta that is slowed by itself: that across the axis, or that about it.
struct Part {
  Sym3 within;  // projects on it
  Vec3 theta;
  Slowing slowing;
  Part(const Sym3& within, Vec3 theta)
      : within(within), theta(within * theta), slowing(slowing_of(norm(within * theta))) {}
  Vec3 slowed() const { return slowing.share * theta; }
  Sym3 rate() const { return slowing.share * within + slowing.slope * outer(theta); }
  // The derivative of rate^T torque by theta.
  Sym3 change_of_rate(Vec3 torque) const {
    const double along = dot(theta, torque);
    return slowing.slope * (2.0 * both(theta, within * torque) + along * within) +
           (slowing.curve * along) * outer(theta);
  }
};

struct Parts {
  Part across, about;
  Parts(Vec3 axis, Vec3 theta) : across(bt::across(axis), theta), about(outer(axis), theta) {}
  Vec3 slowed() const { return across.slowed() + about.slowed(); }
  Mat3 rate() const { return full(across.rate() + about.rate()); }
  Sym3 change_of_rate(Vec3 torque) const {
    return across.change_of_rate(torque) + about.change_of_rate(torque);
  }
};

// The theta that is slowed to v.
Vec3 unslowed(Vec3 v) {
  const double angle = norm(v);
  if (angle <= kWholeTurn - kSetsIn) return v;
  const double least = std::min(angle, kMostTurn);
  double t = std::tan(0.5 * least) * kWholeTurn / std::tan(0.5 * kWholeTurn);
  for (int k = 0; k < kNewtonSteps; ++k) {
    const Slowing g = slowing_of(t);
    t -= (g.share * t - least) / (g.share + g.slope * t * t);
  }
  return (t / angle) * v;
}

// The rotation by v: about the axis first, then across it.
Rot3 turned_by(Vec3 axis, Vec3 v) {
  const double about = dot(axis, v);
  if (about == 0) return rotation_by(v);
  return rotation_by(v - about * axis) * rotation_about(axis, about);
}

// The theta with that rotation, by less than half a turn.
Vec3 theta_of(Vec3 axis, const Rot3& rotation) {
  const Vec3 across = cross(axis, rotation * axis);
  const Vec3 swing = std::atan2(norm(across), dot(axis, rotation * axis)) * unit_or(across, {});
  const double about = dot(axis, rotation_vector(transposed(rotation_by(swing)) * rotation));
  return unslowed(swing) + unslowed(about * axis);
}

// By rows: T.
Mat3 rate_of(Vec3 psi) {
  const Series s = series_of(norm(psi));
  auto row = [&](Vec3 e) { return e + s.a * cross(e, psi) + s.b * cross(psi, cross(psi, e)); };
  return {row({1, 0, 0}), row({0, 1, 0}), row({0, 0, 1})};
}

// By rows: T (1 - a a^T) + exp(s) a a^T.
Mat3 rate_of(Vec3 axis, Vec3 psi) {
  if (norm(axis) == 0) return rate_of(psi);
  const Vec3 swing = psi - dot(axis, psi) * axis;
  return rate_of(swing) * full(across(axis)) + outer_product(rotation_by(swing) * axis, axis);
}

// The symmetric part of the derivative of T^T torque by psi, and the same with an axis.
Sym3 change_of_rate(Vec3 psi, Vec3 torque) {
  const Series s = series_of(norm(psi));
  const double along = dot(psi, torque);
  return s.a_slope * both(psi, cross(torque, psi)) + s.b * (identity(along) + (-1.0) * both(psi, torque)) +
         s.b_slope * both(psi, along * psi - dot(psi, psi) * torque);
}

Sym3 change_of_rate(Vec3 axis, Vec3 psi, Vec3 torque) {
  if (norm(axis) == 0) return change_of_rate(psi, torque);
  const Vec3 swing = psi - dot(axis, psi) * axis;
  const Mat3 across = full(bt::across(axis));
  const Vec3 tilting = transposed_times(rate_of(swing), cross(rotation_by(swing) * axis, torque));
  return within(across, change_of_rate(swing, torque)) + both(axis, across * tilting);
}

}  // namespace

Rot3 rotation_of_step(Vec3 theta) { return rotation_by(slowed(theta)); }

void FiniteRotation::begin(Vec3 about, Vec3 before, Vec3 within_substep) {
  axis = about;
  begun = before;
  more = within_substep;
  predicted = begun + more;
  if (norm(axis) > 0) predicted = theta_of(axis, rotation_of_step(predicted));
}

Rot3 FiniteRotation::since_begun(Vec3 theta) const {
  return turned_by(axis, Parts(axis, theta).slowed()) * rotation_of_step(-begun);
}

void FiniteRotation::turn_by(Vec3 by) {
  theta = predicted + by;
  const Parts parts(axis, theta);
  const Vec3 psi = parts.slowed();
  rotation = turned_by(axis, psi) * rotation_of_step(-begun);
  rate = rate_of(axis, psi) * parts.rate();
}

Vec3 FiniteRotation::beyond_theta() const {
  if (norm(axis) == 0) return {};
  const Vec3 reached = unslowed(rotation_vector(turned_by(axis, Parts(axis, theta).slowed())));
  return (reached - (begun + more)) - (theta - predicted);
}

void FiniteRotation::add_pull(Vec3 arm, Vec3 f, Vec3 torque) {
  const Vec3 half = 0.5 * (torque - cross(arm, f));
  pulls.r0 += arm.x * f + Vec3{0, half.z, -half.y};
  pulls.r1 += arm.y * f + Vec3{-half.z, 0, half.x};
  pulls.r2 += arm.z * f + Vec3{half.y, -half.x, 0};
}

Sym3 FiniteRotation::stiffness() const {
  const Vec3 torque = cross_of(pulls);
  const Sym3 of_arms = upper(0.5 * (pulls + transposed(pulls))) + identity(-trace(pulls));
  const Parts parts(axis, theta);
  const Vec3 psi = parts.slowed();
  return within(rate, of_arms) + within(parts.rate(), change_of_rate(axis, psi, torque)) +
         parts.change_of_rate(transposed_times(rate_of(axis, psi), torque));
}

}  // namespace bt
