// 3x3 matrices: plain values, every operation inline.
#pragma once
#include "math/sym3.h"

namespace bt {

// By rows.
struct Mat3 {
  Vec3 r0, r1, r2;
  Vec3 row(int i) const { return i == 0 ? r0 : i == 1 ? r1 : r2; }
  double entry(int i, int j) const { return dot(row(i), unit_axis(j)); }
};

inline Vec3 operator*(const Mat3& a, Vec3 v) { return {dot(a.r0, v), dot(a.r1, v), dot(a.r2, v)}; }
inline Vec3 transposed_times(const Mat3& a, Vec3 v) { return v.x * a.r0 + v.y * a.r1 + v.z * a.r2; }
inline Mat3 transposed(const Mat3& a) {
  return {{a.r0.x, a.r1.x, a.r2.x}, {a.r0.y, a.r1.y, a.r2.y}, {a.r0.z, a.r1.z, a.r2.z}};
}
inline Mat3 operator*(const Mat3& a, const Mat3& b) {
  return {transposed_times(b, a.r0), transposed_times(b, a.r1), transposed_times(b, a.r2)};
}
inline Mat3 operator+(const Mat3& a, const Mat3& b) { return {a.r0 + b.r0, a.r1 + b.r1, a.r2 + b.r2}; }
inline Mat3 operator-(const Mat3& a, const Mat3& b) { return {a.r0 - b.r0, a.r1 - b.r1, a.r2 - b.r2}; }
inline Mat3 operator*(double s, const Mat3& a) { return {s * a.r0, s * a.r1, s * a.r2}; }
inline Mat3& operator+=(Mat3& a, const Mat3& b) { return a = a + b; }

inline double trace(const Mat3& a) { return a.r0.x + a.r1.y + a.r2.z; }
inline Mat3 outer_product(Vec3 a, Vec3 b) { return {a.x * b, a.y * b, a.z * b}; }
// a x f, summed over the outer products of vectors a and f.
inline Vec3 cross_of(const Mat3& products) {
  return {products.r1.z - products.r2.y, products.r2.x - products.r0.z, products.r0.y - products.r1.x};
}
// The product with the matrix that takes u to arm x u.
inline Mat3 times_cross(const Mat3& a, Vec3 arm) {
  return {cross(a.r0, arm), cross(a.r1, arm), cross(a.r2, arm)};
}

inline Mat3 full(const Sym3& s) { return {{s.xx, s.xy, s.xz}, {s.xy, s.yy, s.yz}, {s.xz, s.yz, s.zz}}; }
// The upper triangle of a symmetric matrix.
inline Sym3 upper(const Mat3& a) { return {a.r0.x, a.r0.y, a.r0.z, a.r1.y, a.r1.z, a.r2.z}; }

}  // namespace bt
