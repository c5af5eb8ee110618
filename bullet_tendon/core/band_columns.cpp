// Solutions of band.h for eight right-hand sides at once, which are zero but for some blocks.
//
// As of one right-hand side: what is eliminated before the first block that is not zero stays zero, and only
// the blocks that somebody reads are solved back to.
#include <algorithm>

#include "band.h"

namespace bt {

namespace {

// out = z^T y, by the columns of a block z.
template <int Lane>
BT_WITHIN inline void transposed_times(const Lanes* z, const Eight* y, Eight* out) {
  for (int c = 0; c < 3; ++c) out[c] = z[c][Lane] * y[0] + z[3 + c][Lane] * y[1] + z[6 + c][Lane] * y[2];
}

template <int Lane>
BT_WITHIN inline void pivot_solve(const Lanes* f, Eight* x) {
  x[1] -= f[0][Lane] * x[0];
  x[2] -= f[1][Lane] * x[0] + f[2][Lane] * x[1];
  x[0] *= f[3][Lane], x[1] *= f[4][Lane], x[2] *= f[5][Lane];
  x[1] -= f[2][Lane] * x[2];
  x[0] -= f[0][Lane] * x[1] + f[1][Lane] * x[2];
}

BT_WITHIN inline void subtract(Eight* from, const Eight* what) {
  for (int c = 0; c < 3; ++c) from[c] -= what[c];
}

}  // namespace

// Steps `from` on of one end, whose block of step s is at(s); what is left to take from the next two.
template <int H, int Lane, class At>
BT_WITHIN inline void BandFactor::columns_inwards(int from, At at, Eight* next, Eight* after) const {
  for (int c = 0; c < 3; ++c) next[c] = after[c] = Eight{};
  for (int s = from; s < steps_; ++s) {
    const Pivot& p = pivots_[s];
    Eight* x = at(s);
    Eight y[3];
    for (int c = 0; c < 3; ++c) x[c] = y[c] = x[c] - next[c];
    transposed_times<Lane>(p.z[0], y, next);
    if constexpr (H == 2) {
      for (int c = 0; c < 3; ++c) next[c] += after[c];
      transposed_times<Lane>(p.z[1], y, after);
    }
    pivot_solve<Lane>(p.ldl, x);
  }
}

template <int H, int Lane, class At>
BT_WITHIN inline void BandFactor::columns_outwards(int to, At at) const {
  for (int s = steps_ - 1; s >= to; --s) {
    const Pivot& p = pivots_[s];
    Eight* x = at(s);
    for (int o = 0; o < H; ++o) {
      const Eight* v = at(s + o + 1);
      for (int r = 0; r < 3; ++r)
        x[r] -= p.z[o][3 * r][Lane] * v[0] + p.z[o][3 * r + 1][Lane] * v[1] + p.z[o][3 * r + 2][Lane] * v[2];
    }
  }
}

template <int H>
BT_WITHIN inline void BandFactor::columns_ends(int first, int last, Columns& x) const {
  const int w = middle_;
  auto top = [&](int s) BT_WITHIN { return x.at(s); };
  auto bottom = [&](int s) BT_WITHIN { return x.at(n_ - 1 - s); };
  Eight next[2][3], after[2][3];
  columns_inwards<H, 0>(first, top, next[0], after[0]);
  columns_inwards<H, 1>(n_ - 1 - last, bottom, next[1], after[1]);
  subtract(x.at(steps_), next[0]), subtract(x.at(steps_ + w - 1), next[1]);
  if (H == 2 && steps_ > 0) subtract(x.at(steps_ + 1), after[0]), subtract(x.at(steps_ + w - 2), after[1]);
  solve_middle<kLanes>(x.number(steps_));
  columns_outwards<H, 0>(first, top);
  columns_outwards<H, 1>(n_ - 1 - last, bottom);
}

BT_VECTOR void BandFactor::solve(const Columns& b, int first, int last, Columns& x) const {
  const int lo = std::min(first, steps_), hi = std::max(last, n_ - 1 - steps_);
  for (int i = lo; i <= hi; ++i)
    for (int c = 0; c < 3; ++c) x.at(i)[c] = b.at(i)[c];
  half_ == 1 ? columns_ends<1>(first, last, x) : columns_ends<2>(first, last, x);
}

}  // namespace bt
