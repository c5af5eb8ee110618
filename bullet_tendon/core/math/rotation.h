// Rotations and rigid placements: plain values, every operation inline.
#pragma once
#include <cmath>

#include "math/vec3.h"

namespace bt {

// Directions that are each turned from the last by it are spread evenly, however many there are [rad].
constexpr double kGoldenAngle = 2.399963229728653;

inline bool same(Vec3 a, Vec3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

// A rotation matrix, by rows.
struct Rot3 {
  Vec3 r0{1, 0, 0}, r1{0, 1, 0}, r2{0, 0, 1};
};

// A rigid placement: world = rotation * local + origin.
struct Pose {
  Rot3 rotation;
  Vec3 origin;
};

inline bool same(const Pose& a, const Pose& b) {
  return same(a.origin, b.origin) && same(a.rotation.r0, b.rotation.r0) &&
         same(a.rotation.r1, b.rotation.r1) && same(a.rotation.r2, b.rotation.r2);
}

inline Vec3 operator*(const Rot3& a, Vec3 v) { return {dot(a.r0, v), dot(a.r1, v), dot(a.r2, v)}; }
inline Vec3 transposed_times(const Rot3& a, Vec3 v) { return v.x * a.r0 + v.y * a.r1 + v.z * a.r2; }

inline Rot3 transposed(const Rot3& r) {
  return {{r.r0.x, r.r1.x, r.r2.x}, {r.r0.y, r.r1.y, r.r2.y}, {r.r0.z, r.r1.z, r.r2.z}};
}
inline Rot3 operator*(const Rot3& a, const Rot3& b) {
  auto row = [&](Vec3 r) { return r.x * b.r0 + r.y * b.r1 + r.z * b.r2; };
  return {row(a.r0), row(a.r1), row(a.r2)};
}
// Of matrices that need not be rotations.
inline Rot3 outer_product(Vec3 a, Vec3 b) { return {a.x * b, a.y * b, a.z * b}; }
inline Rot3 operator+(const Rot3& a, const Rot3& b) { return {a.r0 + b.r0, a.r1 + b.r1, a.r2 + b.r2}; }
inline Rot3 operator-(const Rot3& a, const Rot3& b) { return {a.r0 - b.r0, a.r1 - b.r1, a.r2 - b.r2}; }
inline Rot3 operator*(double s, const Rot3& a) { return {s * a.r0, s * a.r1, s * a.r2}; }
// The rotation vector of a rotation by less than half a turn [rad].
inline Vec3 rotation_vector(const Rot3& r) {
  const Vec3 twice{r.r2.y - r.r1.z, r.r0.z - r.r2.x, r.r1.x - r.r0.y};
  const double sine = 0.5 * norm(twice), cosine = 0.5 * (r.r0.x + r.r1.y + r.r2.z - 1);
  return sine > 0 ? (0.5 * std::atan2(sine, cosine) / sine) * twice : Vec3{};
}
// Rotation matrix of a quaternion x, y, z, w, which need not be normalised.
inline Rot3 rotation_of(const double* q) {
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  const double s = 2 / (x * x + y * y + z * z + w * w);
  return {{1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)},
          {s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)},
          {s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)}};
}
// By an angle [rad] about the unit vector n (Rodrigues).
inline Rot3 rotation_about(Vec3 n, double angle) {
  const double s = std::sin(angle), c = std::cos(angle);
  auto row = [&](Vec3 e) { return c * e + (1 - c) * dot(n, e) * n + s * cross(e, n); };
  return {row({1, 0, 0}), row({0, 1, 0}), row({0, 0, 1})};
}

// By the rotation vector v [rad].
inline Rot3 rotation_by(Vec3 v) { return rotation_about(unit_or(v, {0, 0, 1}), norm(v)); }

inline Vec3 to_world(const Pose& p, Vec3 local) { return p.rotation * local + p.origin; }
inline Vec3 to_local(const Pose& p, Vec3 world) { return transposed_times(p.rotation, world - p.origin); }

}  // namespace bt
