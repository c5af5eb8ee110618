#include "swept_boxes.h"

namespace bt {

Box swept_box(const Chain& c, int segment, Vec3 mean_motion, double skin) {
  Box box;
  for (int i : {segment, segment + 1}) box.include(c.x.at(i)), box.include(c.foreseen.at(i) - mean_motion);
  box.grow(skin + std::max(c.slack[segment], c.slack[segment + 1]));
  return box;
}

void SweptBoxes::fit(const Chain& c, Vec3 mean_motion, double skin) {
  const int m = c.n() - 1;
  segments.resize(m);
  leaves.assign((m + kLeaf - 1) / kLeaf, Box{});
  branches.assign((leaves.size() + kLeaf - 1) / kLeaf, Box{});
  all = Box{};
  for (int k = 0; k < m; ++k) leaves[k / kLeaf].include(segments[k] = swept_box(c, k, mean_motion, skin));
  for (size_t i = 0; i < leaves.size(); ++i) branches[i / kLeaf].include(leaves[i]);
  for (const Box& b : branches) all.include(b);
}

}  // namespace bt
