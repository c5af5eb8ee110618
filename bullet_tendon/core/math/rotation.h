// Rotations and rigid placements: plain values, every operation inline.
#pragma once
#include <cmath>

#include "math/mat3.h"

namespace bt {

// Directions that are each turned from the last by it are spread evenly, however many there are [rad].
constexpr double kGoldenAngle = 2.399963229728653;

inline bool same(Vec3 a, Vec3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

// A rotation matrix.
struct Rot3 : Mat3 {
  Rot3() : Rot3(Vec3{1, 0, 0}, {0, 1, 0}, {0, 0, 1}) {}
  Rot3(Vec3 row0, Vec3 row1, Vec3 row2) : Mat3{row0, row1, row2} {}
  Rot3(const Mat3& a) : Mat3(a) {}
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

// The rotation vector of a rotation by less than half a turn [rad].
inline Vec3 rotation_vector(const Rot3& r) {
  const Vec3 twice = -cross_of(r);
  const double sine = 0.5 * norm(twice), cosine = 0.5 * (trace(r) - 1);
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
