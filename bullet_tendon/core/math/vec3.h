// Vectors: plain values, every operation inline.
#pragma once
#include <algorithm>
#include <cmath>

namespace bt {

struct Vec3 {
  double x = 0, y = 0, z = 0;
};

inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline Vec3& operator+=(Vec3& a, Vec3 b) { return a = a + b; }
inline Vec3& operator-=(Vec3& a, Vec3 b) { return a = a - b; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(Vec3 a) { return std::sqrt(dot(a, a)); }
inline Vec3 unit_or(Vec3 a, Vec3 fallback) {
  double l = norm(a);
  return l > 0 ? (1 / l) * a : fallback;
}
inline Vec3 any_perpendicular(Vec3 a) {
  Vec3 other = std::fabs(a.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  return unit_or(cross(a, other), Vec3{0, 0, 1});
}
// Largest |component|; NaN if one of them is not finite (std::max would lose it).
inline double max_abs(Vec3 a) {
  return std::max({std::fabs(a.x), std::fabs(a.y), std::fabs(a.z)}) + 0 * (a.x + a.y + a.z);
}
inline Vec3 lowest(Vec3 a, Vec3 b) { return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)}; }
inline Vec3 highest(Vec3 a, Vec3 b) { return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)}; }
inline Vec3 unit_axis(int k) { return {k == 0 ? 1.0 : 0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0}; }
inline Vec3 without(Vec3 a, Vec3 n) { return a - dot(a, n) * n; }  // n: unit
// Direction of `a` across the unit vector n; where it has none, any direction across it.
inline Vec3 direction_across(Vec3 a, Vec3 n) {
  const Vec3 across = without(a, n);
  const double size = norm(across);
  return size > 0 ? (1 / size) * across : any_perpendicular(n);
}

}  // namespace bt
