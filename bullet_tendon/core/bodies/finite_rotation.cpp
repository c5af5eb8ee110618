#include "bodies/finite_rotation.h"

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
Sym3 within(const Rot3& m, const Sym3& s) {
  auto column = [&](int k) { return transposed_times(m, s * (m * unit_axis(k))); };
  const Vec3 x = column(0), y = column(1), z = column(2);
  return {x.x, x.y, x.z, y.y, y.z, z.z};
}

Vec3 slowed(Vec3 theta) { return slowing_of(norm(theta)).share * theta; }

// By rows: T, P.
Rot3 rate_of(Vec3 psi) {
  const Series s = series_of(norm(psi));
  auto row = [&](Vec3 e) { return e + s.a * cross(e, psi) + s.b * cross(psi, cross(psi, e)); };
  return {row({1, 0, 0}), row({0, 1, 0}), row({0, 0, 1})};
}

Rot3 slowing_rate_of(Vec3 theta) {
  const Slowing g = slowing_of(norm(theta));
  auto row = [&](Vec3 e) { return g.share * e + g.slope * dot(theta, e) * theta; };
  return {row({1, 0, 0}), row({0, 1, 0}), row({0, 0, 1})};
}

}  // namespace

Rot3 rotation_of_step(Vec3 theta) { return rotation_by(slowed(theta)); }

Rot3 FiniteRotation::since_begun(Vec3 theta) const {
  return rotation_of_step(theta) * rotation_of_step(-begun);
}

void FiniteRotation::turn_by(Vec3 by) {
  theta = begun + more + by;
  rotation = since_begun(theta);
  rate = rate_of(slowed(theta)) * slowing_rate_of(theta);
}

void FiniteRotation::add_pull(Vec3 arm, Vec3 f, Vec3 torque) {
  const Vec3 half = 0.5 * (torque - cross(arm, f));
  pulls.r0 += arm.x * f + Vec3{0, half.z, -half.y};
  pulls.r1 += arm.y * f + Vec3{-half.z, 0, half.x};
  pulls.r2 += arm.z * f + Vec3{half.y, -half.x, 0};
}

Sym3 FiniteRotation::stiffness() const {
  const Rot3& p = pulls;
  const double out = p.r0.x + p.r1.y + p.r2.z;
  const Vec3 torque{p.r1.z - p.r2.y, p.r2.x - p.r0.z, p.r0.y - p.r1.x};
  const Sym3 of_arms = {p.r0.x - out, 0.5 * (p.r0.y + p.r1.x), 0.5 * (p.r0.z + p.r2.x),
                        p.r1.y - out, 0.5 * (p.r1.z + p.r2.y), p.r2.z - out};
  const Vec3 psi = slowed(theta);
  const Series s = series_of(norm(psi));
  const double along = dot(psi, torque);
  const Sym3 of_rate = s.a_slope * both(psi, cross(torque, psi)) +
                       s.b * (identity(along) + (-1.0) * both(psi, torque)) +
                       s.b_slope * both(psi, along * psi - dot(psi, psi) * torque);
  const Slowing g = slowing_of(norm(theta));
  const Vec3 on_psi = transposed_times(rate_of(psi), torque);
  const double all = dot(theta, on_psi);
  return within(rate, of_arms) + within(slowing_rate_of(theta), of_rate) +
         g.slope * (2.0 * both(theta, on_psi) + identity(all)) + (g.curve * all) * outer(theta);
}

}  // namespace bt
