// Boxes around where a tendon's segments are and, as foreseen, will be at the end of the step, relative to
// its mean motion: one for each, one for every eight, one for all. For what moves so fast that searches do
// not last.
#pragma once
#include <vector>

#include "box.h"
#include "chain.h"

namespace bt {

// Grown by skin and slack.
Box swept_box(const Chain& c, int segment, Vec3 mean_motion, double skin);

struct SweptBoxes {
  static constexpr int kLeaf = 8;
  std::vector<Box> segments, leaves, branches;
  Box all;
  void fit(const Chain& c, Vec3 mean_motion, double skin);
};

// Pairs of segments whose boxes are within the margin; of one tendon, k before m.
template <class Do>
void each_overlap(const SweptBoxes& a, const SweptBoxes& b, double margin, Do what) {
  constexpr int L = SweptBoxes::kLeaf;
  const bool self = &a == &b;
  auto each = [&](const std::vector<Box>& p, const std::vector<Box>& q, int i, int j, auto next) {
    const int end_i = std::min((i + 1) * L, static_cast<int>(p.size()));
    const int end_j = std::min((j + 1) * L, static_cast<int>(q.size()));
    for (int k = i * L; k < end_i; ++k)
      for (int m = self ? std::max(j * L, k) : j * L; m < end_j; ++m)
        if (overlap(p[k], q[m], margin)) next(k, m);
  };
  if (!overlap(a.all, b.all, margin)) return;
  for (int i = 0; i < static_cast<int>(a.branches.size()); ++i)
    for (int j = self ? i : 0; j < static_cast<int>(b.branches.size()); ++j)
      if (overlap(a.branches[i], b.branches[j], margin))
        each(a.leaves, b.leaves, i, j, [&](int k, int m) { each(a.segments, b.segments, k, m, what); });
}

}  // namespace bt
