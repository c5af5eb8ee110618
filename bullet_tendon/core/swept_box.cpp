#include "swept_box.h"

namespace bt {

Box swept_box(const Chain& c, int segment, Vec3 mean_motion, double skin) {
  Box box;
  for (int i : {segment, segment + 1}) box.include(c.x.at(i)), box.include(c.foreseen.at(i) - mean_motion);
  box.grow(skin + std::max(c.slack[segment], c.slack[segment + 1]));
  return box;
}

}  // namespace bt
