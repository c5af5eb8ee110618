// Bounds of points: boxes along the axes, and bounds on how far points move.
#pragma once
#include "math/soa_field.h"

namespace bt {

struct Box {
  Vec3 lo{1e300, 1e300, 1e300}, hi{-1e300, -1e300, -1e300};
  void include(Vec3 p) {
    lo = lowest(lo, p);
    hi = highest(hi, p);
  }
  void include(const Box& b) {
    include(b.lo);
    include(b.hi);
  }
  Vec3 middle() const { return 0.5 * (lo + hi); }
  double half_diagonal() const { return 0.5 * norm(hi - lo); }
  void grow(double margin) {
    Vec3 m{margin, margin, margin};
    lo -= m;
    hi += m;
  }
};
inline Box box_of(const Field& points) {
  Box box;
  for (int i = 0; i < points.size(); ++i) box.include(points.at(i));
  return box;
}
inline bool overlap(const Box& a, const Box& b, double m = 0) {  // within the margin m
  return a.lo.x <= b.hi.x + m && b.lo.x <= a.hi.x + m && a.lo.y <= b.hi.y + m && b.lo.y <= a.hi.y + m &&
         a.lo.z <= b.hi.z + m && b.lo.z <= a.hi.z + m;
}
// Distance of two boxes along each axis; 0 where they overlap.
inline Vec3 gap_between(const Box& a, const Box& b) { return highest(highest(a.lo - b.hi, b.lo - a.hi), {}); }

// Of points that all move by `by`, each of them give or take `off` [m].
struct MotionBound {
  Vec3 by;
  double off = 0;
};

inline MotionBound motion_between(const Field& from, const Field& to) {
  Box moved;
  for (int i = 0; i < from.size(); ++i) moved.include(to.at(i) - from.at(i));
  return {moved.middle(), moved.half_diagonal()};
}

// By how much a point of one and a point of the other approach each other at most [m].
inline double relative_motion(const MotionBound& a, const MotionBound& b) {
  return norm(a.by - b.by) + a.off + b.off;
}

}  // namespace bt
