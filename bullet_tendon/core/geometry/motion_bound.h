// Bounds on how far points move.
#pragma once
#include "math/soa_field.h"

namespace bt {

// Of points that all move by `by`, each of them give or take `off` [m].
struct MotionBound {
  Vec3 by;
  double off = 0;
};

MotionBound motion_between(const Field& from, const Field& to);

// By how much a point of one and a point of the other approach each other at most [m].
inline double relative_motion(const MotionBound& a, const MotionBound& b) {
  return norm(a.by - b.by) + a.off + b.off;
}

}  // namespace bt
