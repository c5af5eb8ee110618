#include "geometry/bounds.h"

#include <algorithm>

#include "math/simd.h"

namespace bt {

namespace {

// Eight numbers side by side, in two vectors of four, wherever they begin: vectors of eight are taken apart
// number by number where the machine has none.
typedef double Four __attribute__((vector_size(32), aligned(sizeof(double)), may_alias));

struct Range {
  Four least[2];
  Four most[2];
};

// Of to - from by component. The last eight may overlap those before them.
BT_VECTOR void find_ranges(const Field& from, const Field& to, Range (&range)[3]) {
  const int n = from.size();
  for (int c = 0; c < 3; ++c) {
    const double *p = from[c], *q = to[c];
    const Four far = Four{} + 1e300;
    Range found{{far, far}, {-far, -far}};
    for (int k = 0; k < n && n >= kLanes; k += kLanes) {
      const int i = std::min(k, n - kLanes);
      for (int h = 0; h < 2; ++h) {
        const Four moved =
            *reinterpret_cast<const Four*>(q + i + 4 * h) - *reinterpret_cast<const Four*>(p + i + 4 * h);
        found.least[h] = moved < found.least[h] ? moved : found.least[h];
        found.most[h] = moved > found.most[h] ? moved : found.most[h];
      }
    }
    for (int i = 0; i < n && n < kLanes; ++i) {
      found.least[i / 4][i % 4] = q[i] - p[i];
      found.most[i / 4][i % 4] = q[i] - p[i];
    }
    range[c] = found;
  }
}

}  // namespace

MotionBound motion_between(const Field& from, const Field& to) {
  Range range[3];
  find_ranges(from, to, range);
  double low[3], high[3];
  for (int c = 0; c < 3; ++c) {
    low[c] = range[c].least[0][0];
    high[c] = range[c].most[0][0];
    for (int l = 1; l < kLanes; ++l) {
      low[c] = std::min(low[c], range[c].least[l / 4][l % 4]);
      high[c] = std::max(high[c], range[c].most[l / 4][l % 4]);
    }
  }
  const Vec3 least{low[0], low[1], low[2]}, most{high[0], high[1], high[2]};
  return {0.5 * (least + most), 0.5 * norm(most - least)};
}

}  // namespace bt
