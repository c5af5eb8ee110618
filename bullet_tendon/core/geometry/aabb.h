// Boxes along the axes.
#pragma once
#include "math/vec3.h"

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
  void grow(double margin) {
    Vec3 m{margin, margin, margin};
    lo -= m;
    hi += m;
  }
};
inline bool overlap(const Box& a, const Box& b, double m = 0) {  // within the margin m
  return a.lo.x <= b.hi.x + m && b.lo.x <= a.hi.x + m && a.lo.y <= b.hi.y + m && b.lo.y <= a.hi.y + m &&
         a.lo.z <= b.hi.z + m && b.lo.z <= a.hi.z + m;
}
// Distance of two boxes along each axis; 0 where they overlap.
inline Vec3 gap_between(const Box& a, const Box& b) { return highest(highest(a.lo - b.hi, b.lo - a.hi), {}); }

}  // namespace bt
