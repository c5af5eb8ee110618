// Vectors and symmetric 3x3 matrices: plain values, every operation inline.
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
// Largest component; not a number where one of them is not finite (std::max would lose it).
inline double max_abs(Vec3 a) {
  return std::max({std::fabs(a.x), std::fabs(a.y), std::fabs(a.z)}) + 0 * (a.x + a.y + a.z);
}
inline Vec3 lowest(Vec3 a, Vec3 b) { return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)}; }
inline Vec3 highest(Vec3 a, Vec3 b) { return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)}; }
inline Vec3 unit_axis(int k) { return {k == 0 ? 1.0 : 0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0}; }
inline Vec3 without(Vec3 a, Vec3 n) { return a - dot(a, n) * n; }  // n: unit

// Symmetric, stored xx xy xz yy yz zz.
struct Sym3 {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
};

inline Sym3 operator+(Sym3 a, Sym3 b) {
  return {a.xx + b.xx, a.xy + b.xy, a.xz + b.xz, a.yy + b.yy, a.yz + b.yz, a.zz + b.zz};
}
inline Sym3 operator*(double s, Sym3 a) {
  return {s * a.xx, s * a.xy, s * a.xz, s * a.yy, s * a.yz, s * a.zz};
}
inline Sym3& operator+=(Sym3& a, Sym3 b) { return a = a + b; }
inline Vec3 operator*(const Sym3& a, Vec3 v) {
  return {a.xx * v.x + a.xy * v.y + a.xz * v.z, a.xy * v.x + a.yy * v.y + a.yz * v.z,
          a.xz * v.x + a.yz * v.y + a.zz * v.z};
}
inline double trace(const Sym3& a) { return a.xx + a.yy + a.zz; }
inline Sym3 identity(double s) { return {s, 0, 0, s, 0, s}; }
inline Sym3 outer(Vec3 a) { return {a.x * a.x, a.x * a.y, a.x * a.z, a.y * a.y, a.y * a.z, a.z * a.z}; }
// I - n n^T, the projector across the unit vector n.
inline Sym3 across(Vec3 n) { return identity(1) + (-1.0) * outer(n); }

inline Sym3 inverse(const Sym3& a) {
  double cxx = a.yy * a.zz - a.yz * a.yz, cxy = a.xz * a.yz - a.xy * a.zz, cxz = a.xy * a.yz - a.xz * a.yy;
  double det = a.xx * cxx + a.xy * cxy + a.xz * cxz;
  return (1 / det) *
         Sym3{cxx, cxy, cxz, a.xx * a.zz - a.xz * a.xz, a.xy * a.xz - a.xx * a.yz, a.xx * a.yy - a.xy * a.xy};
}

// The inverse of a positive definite matrix by its pivots, which bad condition harms less than cofactors do.
// false: a pivot is not positive.
inline bool invert_definite(Sym3& a) {
  const double d1 = a.xx;
  if (!(d1 > 0)) return false;
  const double l21 = a.xy / d1, l31 = a.xz / d1, d2 = a.yy - l21 * a.xy;
  if (!(d2 > 0)) return false;
  const double l32 = (a.yz - l31 * a.xy) / d2, d3 = a.zz - l31 * a.xz - l32 * l32 * d2;
  if (!(d3 > 0)) return false;
  // L^-1 has -l21, -l32 and l21 l32 - l31 below its ones.
  const double m = l21 * l32 - l31, i1 = 1 / d1, i2 = 1 / d2, i3 = 1 / d3;
  a = {
      i1 + l21 * l21 * i2 + m * m * i3, -l21 * i2 - m * l32 * i3, m * i3, i2 + l32 * l32 * i3, -l32 * i3, i3};
  return true;
}

// A rotation, by rows.
struct Rot3 {
  Vec3 r0{1, 0, 0}, r1{0, 1, 0}, r2{0, 0, 1};
};
inline Vec3 operator*(const Rot3& a, Vec3 v) { return {dot(a.r0, v), dot(a.r1, v), dot(a.r2, v)}; }
inline Vec3 transposed_times(const Rot3& a, Vec3 v) { return v.x * a.r0 + v.y * a.r1 + v.z * a.r2; }

inline Rot3 transposed(const Rot3& r) {
  return {{r.r0.x, r.r1.x, r.r2.x}, {r.r0.y, r.r1.y, r.r2.y}, {r.r0.z, r.r1.z, r.r2.z}};
}
inline Rot3 operator*(const Rot3& a, const Rot3& b) {
  auto row = [&](Vec3 r) { return r.x * b.r0 + r.y * b.r1 + r.z * b.r2; };
  return {row(a.r0), row(a.r1), row(a.r2)};
}
// Of a quaternion x, y, z, w.
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

// A rigid placement: world = rotation * local + origin.
struct Pose {
  Rot3 rotation;
  Vec3 origin;
};
inline Vec3 to_world(const Pose& p, Vec3 local) { return p.rotation * local + p.origin; }
inline Vec3 to_local(const Pose& p, Vec3 world) { return transposed_times(p.rotation, world - p.origin); }

}  // namespace bt
