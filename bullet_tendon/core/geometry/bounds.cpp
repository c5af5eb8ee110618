#include "geometry/bounds.h"

namespace bt {

MotionBound motion_between(const Field& from, const Field& to) {
  Box moved;
  for (int i = 0; i < from.size(); ++i) moved.include(to.at(i) - from.at(i));
  return {0.5 * (moved.lo + moved.hi), 0.5 * norm(moved.hi - moved.lo)};
}

}  // namespace bt
