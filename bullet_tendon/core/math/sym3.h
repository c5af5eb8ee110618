// Symmetric 3x3 matrices: plain values, every operation inline.
#pragma once
#include "math/vec3.h"

namespace bt {

// Symmetric, stored xx xy xz yy yz zz.
struct Sym3 {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
};

// Number of entry (row, column) of the whole matrix among those that are stored.
constexpr int kFull[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};

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

// The inverse of a positive definite matrix by its pivots, which is more accurate than cofactors for badly
// conditioned matrices. false: a pivot is not positive.
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

}  // namespace bt
