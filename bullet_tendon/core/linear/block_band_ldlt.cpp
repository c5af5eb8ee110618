#include "linear/block_band_ldlt.h"

#include <algorithm>

namespace bt {

Sym3 symmetric_at(const Planes& p, int i) { return {p[0][i], p[1][i], p[2][i], p[3][i], p[4][i], p[5][i]}; }

void set(Planes& planes, int i, const Sym3& b) {
  const double v[6] = {b.xx, b.xy, b.xz, b.yy, b.yz, b.zz};
  for (int c = 0; c < 6; ++c) planes[c][i] = v[c];
}

Mat3 block_at(const Planes& p, int i) {
  return {{p[0][i], p[1][i], p[2][i]}, {p[3][i], p[4][i], p[5][i]}, {p[6][i], p[7][i], p[8][i]}};
}

void set(Planes& planes, int i, const Mat3& b) {
  for (int r = 0; r < 3; ++r) {
    const Vec3 row = b.row(r);
    planes[3 * r][i] = row.x;
    planes[3 * r + 1][i] = row.y;
    planes[3 * r + 2][i] = row.z;
  }
}

void Band::resize(int blocks, int half_bandwidth) {
  n = blocks;
  half = half_bandwidth;
  diagonal.resize(6, n);
  for (int o = 0; o < 2; ++o) below[o].resize(o < half ? 9 : 0, n);
}

void Band::zero() {
  diagonal.zero();
  for (int o = 0; o < half; ++o) below[o].zero();
}

void Band::add(int i, const Sym3& b) { set(diagonal, i, symmetric_at(diagonal, i) + b); }

void Band::add_below(int i, const Mat3& b, int offset) {
  Planes& blocks = below[offset - 1];
  set(blocks, i, block_at(blocks, i) + b);
}

void Band::multiply(const Field& x, Field& y) const {
  for (int r = 0; r < 3; ++r)
    for (int i = 0; i < n; ++i)
      y[r][i] = diagonal[kFull[3 * r]][i] * x[0][i] + diagonal[kFull[3 * r + 1]][i] * x[1][i] +
                diagonal[kFull[3 * r + 2]][i] * x[2][i];
  for (int o = 0; o < half; ++o)
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) {
        const double* e = below[o][3 * r + c];
        double *yr = y[r], *yc = y[c];
        const double *xr = x[r], *xc = x[c];
        for (int i = 0; i + o + 1 < n; ++i) yr[i + o + 1] += e[i] * xc[i];
        for (int i = 0; i + o + 1 < n; ++i) yc[i] += e[i] * xr[i + o + 1];
      }
}

void Band::hold(int i, const Sym3& N) {
  const Mat3 held = full(N);
  auto without_rows = [&](const Mat3& m) { return m - held * m; };
  auto without_columns = [&](const Mat3& m) { return m - m * held; };
  set(diagonal, i, upper(without_columns(without_rows(full(symmetric_at(diagonal, i))))) + N);
  for (int o = 0; o < half; ++o) {
    const int before = i - o - 1;
    if (i + o + 1 < n) set(below[o], i, without_columns(block_at(below[o], i)));
    if (before >= 0) set(below[o], before, without_rows(block_at(below[o], before)));
  }
}

namespace {

// The factorisation and solution of linear/block_band_ldlt.h.

inline Lanes both(const double* plane, int top, int bottom) { return Lanes{plane[top], plane[bottom]}; }

// Six planes of the diagonal blocks `top` and `bottom`.
inline void load_diagonal(const Planes& d, int top, int bottom, Lanes* out) {
  for (int c = 0; c < 6; ++c) out[c] = both(d[c], top, bottom);
}

// The block that couples a pivot with the one `offset` further inwards: A(top+offset, top) in lane 0,
// A(bottom-offset, bottom) = A(bottom, bottom-offset)^T in lane 1.
inline void load_coupling(const Planes& below, int top, int bottom, int offset, Lanes* out) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      out[3 * r + c] = Lanes{below[3 * r + c][top], below[3 * c + r][bottom - offset]};
}

// xx xy xz yy yz zz -> l21 l31 l32 1/d1 1/d2 1/d3. Returns whether all pivots d are positive.
inline bool ldl(const Lanes* a, Lanes* f) {
  Lanes i1 = 1.0 / a[0];
  Lanes l21 = a[1] * i1, l31 = a[2] * i1;
  Lanes d2 = a[3] - l21 * a[1];
  Lanes i2 = 1.0 / d2;
  Lanes e = a[4] - l21 * a[2];
  Lanes l32 = e * i2;
  Lanes d3 = a[5] - l31 * a[2] - l32 * e;
  f[0] = l21;
  f[1] = l31;
  f[2] = l32;
  f[3] = i1;
  f[4] = i2;
  f[5] = 1.0 / d3;
  return a[0][0] > 0 && a[0][1] > 0 && d2[0] > 0 && d2[1] > 0 && d3[0] > 0 && d3[1] > 0;
}

template <bool Negative>
inline Lanes kept(Lanes inverse_pivots) {
  const Lanes none{};
  if constexpr (Negative) return inverse_pivots < none ? inverse_pivots : none;
  return inverse_pivots;
}

template <bool Negative>
inline void ldl_solve(const Lanes* f, Lanes& x, Lanes& y, Lanes& z) {
  y -= f[0] * x;
  z -= f[1] * x + f[2] * y;
  x *= kept<Negative>(f[3]);
  y *= kept<Negative>(f[4]);
  z *= kept<Negative>(f[5]);
  y -= f[2] * z;
  x -= f[0] * y + f[1] * z;
}

// The first half of Z = D^-1 E^T: W = L^-1 E^T and diag^-1 W. Products E Z' are W^T diag^-1 W'. With these
// the next pivot does not depend on Z.
struct Half {
  Lanes w[9], scaled[9];
};

inline void solve_half(const Lanes* f, const Lanes* e, Half& h) {
  for (int c = 0; c < 3; ++c) {
    const Lanes x = e[3 * c], y = e[3 * c + 1] - f[0] * x, z = e[3 * c + 2] - (f[1] * x + f[2] * y);
    h.w[c] = x;
    h.w[3 + c] = y;
    h.w[6 + c] = z;
    h.scaled[c] = x * f[3];
    h.scaled[3 + c] = y * f[4];
    h.scaled[6 + c] = z * f[5];
  }
}

// Z = L^-T diag^-1 W.
inline void solve_rest(const Lanes* f, const Half& h, Lanes* z) {
  for (int c = 0; c < 3; ++c) {
    const Lanes last = h.scaled[6 + c], y = h.scaled[3 + c] - f[2] * last;
    z[c] = h.scaled[c] - (f[0] * y + f[1] * last);
    z[3 + c] = y;
    z[6 + c] = last;
  }
}

inline Lanes product(const Half& e, int r, const Half& z, int c) {
  return e.w[r] * z.scaled[c] + e.w[3 + r] * z.scaled[3 + c] + e.w[6 + r] * z.scaled[6 + c];
}

// The six distinct entries of E Z, which is symmetric.
inline void symmetric_product(const Half& h, Lanes* out) {
  out[0] = product(h, 0, h, 0);
  out[1] = product(h, 0, h, 1);
  out[2] = product(h, 0, h, 2);
  out[3] = product(h, 1, h, 1);
  out[4] = product(h, 1, h, 2);
  out[5] = product(h, 2, h, 2);
}

}  // namespace

void BandFactor::resize(int blocks, int half_bandwidth) {
  n_ = blocks;
  half_ = half_bandwidth;
  middle_ = half_ == 1 ? (n_ % 2 ? 1 : 2) : (n_ % 2 ? 3 : 2);
  steps_ = (n_ - middle_) / 2;
  pivots_.resize(steps_);
}

bool BandFactor::factorise(const Band& a) {
  bool ok = half_ == 1 ? factorise_ends<1>(a) : factorise_ends<2>(a);
  return factorise_middle(a) && ok;
}

template <int H>
bool BandFactor::factorise_ends(const Band& a) {
  Lanes first[6] = {}, second[6] = {}, between[9] = {};  // subtracted from the next pivots
  bool ok = true;
  for (int s = 0; s < steps_; ++s) {
    const int top = s, bottom = n_ - 1 - s;
    Pivot& p = pivots_[s];
    Lanes d[6], e1[9], e2[9];
    load_diagonal(a.diagonal, top, bottom, d);
    for (int c = 0; c < 6; ++c) d[c] -= first[c];
    load_coupling(a.below[0], top, bottom, 1, e1);
    if constexpr (H == 2) {
      for (int c = 0; c < 9; ++c) e1[c] -= between[c];
      load_coupling(a.below[1], top, bottom, 2, e2);
    }
    ok &= ldl(d, p.ldl);
    Half h1, h2;
    solve_half(p.ldl, e1, h1);
    symmetric_product(h1, first);
    if constexpr (H == 2) {
      for (int c = 0; c < 6; ++c) first[c] += second[c];
      solve_half(p.ldl, e2, h2);
      symmetric_product(h2, second);
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) between[3 * r + c] = product(h2, r, h1, c);
      solve_rest(p.ldl, h2, p.z[1]);
    }
    solve_rest(p.ldl, h1, p.z[0]);
  }
  for (int c = 0; c < 6; ++c) {
    left_[0][c] = first[c];
    left_[1][c] = second[c];
  }
  for (int c = 0; c < 9; ++c) left_[2][c] = between[c];
  return ok;
}

bool BandFactor::factorise_middle(const Band& a) {
  const int w = middle_, m = 3 * w;
  auto at = [&](int i, int j) -> double& { return dense_[9 * i + j]; };
  for (int i = 0; i < m; ++i)
    for (int j = 0; j <= i; ++j) {
      int bi = i / 3, bj = j / 3, r = i % 3, c = j % 3, o = bi - bj;
      at(i, j) = o == 0       ? a.diagonal[kFull[3 * r + c]][steps_ + bi]
                 : o <= half_ ? a.below[o - 1][3 * r + c][steps_ + bj]
                              : 0.0;
    }
  if (steps_ > 0) {
    auto take = [&](int block, int lane, const Lanes* what) {
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c <= r; ++c) at(3 * block + r, 3 * block + c) -= what[kFull[3 * r + c]][lane];
    };
    take(0, 0, left_[0]);
    take(w - 1, 1, left_[0]);
    if (half_ == 2) {
      take(1, 0, left_[1]);
      take(w - 2, 1, left_[1]);
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) {
          at(3 + r, c) -= left_[2][3 * r + c][0];
          at(3 * (w - 1) + r, 3 * (w - 2) + c) -= left_[2][3 * c + r][1];
        }
    }
  }
  bool ok = true;
  double pivot[9];
  for (int j = 0; j < m; ++j) {
    double d = at(j, j), scaled[9];
    for (int k = 0; k < j; ++k) {
      scaled[k] = at(j, k) * pivot[k];
      d -= at(j, k) * scaled[k];
    }
    ok &= d > 0;
    pivot[j] = d;
    at(j, j) = 1 / d;
    for (int i = j + 1; i < m; ++i) {
      double v = at(i, j);
      for (int k = 0; k < j; ++k) v -= at(i, k) * scaled[k];
      at(i, j) = v * at(j, j);
    }
  }
  return ok;
}

void BandFactor::solve(const Field& b, Field& x) const {
  half_ == 1 ? solve_ends<1, false>(b, x) : solve_ends<2, false>(b, x);
}

void BandFactor::solve_negative(const Field& b, Field& x) const {
  half_ == 1 ? solve_ends<1, true>(b, x) : solve_ends<2, true>(b, x);
}

template <int H, bool Negative>
void BandFactor::solve_ends(const Field& b, Field& x) const {
  Lanes first[3] = {}, second[3] = {};
  for (int s = 0; s < steps_; ++s) {
    const Pivot& p = pivots_[s];
    const int top = s, bottom = n_ - 1 - s;
    Lanes y[3], z[3];
    for (int c = 0; c < 3; ++c) z[c] = y[c] = both(b[c], top, bottom) - first[c];
    for (int c = 0; c < 3; ++c) {
      first[c] = p.z[0][c] * y[0] + p.z[0][3 + c] * y[1] + p.z[0][6 + c] * y[2];
      if constexpr (H == 2) {
        first[c] += second[c];
        second[c] = p.z[1][c] * y[0] + p.z[1][3 + c] * y[1] + p.z[1][6 + c] * y[2];
      }
    }
    ldl_solve<Negative>(p.ldl, z[0], z[1], z[2]);
    for (int c = 0; c < 3; ++c) {
      x[c][top] = z[c][0];
      x[c][bottom] = z[c][1];
    }
  }
  double y[9];
  const int w = middle_;
  for (int i = 0; i < w; ++i)
    for (int c = 0; c < 3; ++c) y[3 * i + c] = b[c][steps_ + i];
  for (int c = 0; c < 3; ++c) {
    y[c] -= first[c][0];
    y[3 * (w - 1) + c] -= first[c][1];
    if (H == 2 && steps_ > 0) {
      y[3 + c] -= second[c][0];
      y[3 * (w - 2) + c] -= second[c][1];
    }
  }
  solve_middle<1, Negative>(y);
  for (int i = 0; i < w; ++i)
    for (int c = 0; c < 3; ++c) x[c][steps_ + i] = y[3 * i + c];
  for (int s = steps_ - 1; s >= 0; --s) {
    const Pivot& p = pivots_[s];
    const int top = s, bottom = n_ - 1 - s;
    for (int o = 0; o < H; ++o) {
      Lanes v[3];
      for (int c = 0; c < 3; ++c) v[c] = both(x[c], top + o + 1, bottom - o - 1);
      for (int r = 0; r < 3; ++r) {
        Lanes sum = p.z[o][3 * r] * v[0] + p.z[o][3 * r + 1] * v[1] + p.z[o][3 * r + 2] * v[2];
        x[r][top] -= sum[0];
        x[r][bottom] -= sum[1];
      }
    }
  }
}

namespace {

// Solutions for eight right-hand sides at once, which are zero except for some blocks.
//
// The elimination starts at the first block that is not zero. The back substitution ends at the last block
// that is needed.

// out = z^T y, by the columns of a block z.
template <int Lane>
BT_WITHIN inline void transposed_times(const Lanes* z, const Eight* y, Eight* out) {
  for (int c = 0; c < 3; ++c) out[c] = z[c][Lane] * y[0] + z[3 + c][Lane] * y[1] + z[6 + c][Lane] * y[2];
}

template <int Lane>
BT_WITHIN inline void pivot_solve(const Lanes* f, Eight* x) {
  x[1] -= f[0][Lane] * x[0];
  x[2] -= f[1][Lane] * x[0] + f[2][Lane] * x[1];
  x[0] *= f[3][Lane];
  x[1] *= f[4][Lane];
  x[2] *= f[5][Lane];
  x[1] -= f[2][Lane] * x[2];
  x[0] -= f[0][Lane] * x[1] + f[1][Lane] * x[2];
}

BT_WITHIN inline void subtract(Eight* from, const Eight* what) {
  for (int c = 0; c < 3; ++c) from[c] -= what[c];
}

}  // namespace

// Forward elimination of one end from step `from` on. at(s) is the block of step s. `next` and `after` are
// what remains to be subtracted from the next two blocks.
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
  subtract(x.at(steps_), next[0]);
  subtract(x.at(steps_ + w - 1), next[1]);
  if (H == 2 && steps_ > 0) {
    subtract(x.at(steps_ + 1), after[0]);
    subtract(x.at(steps_ + w - 2), after[1]);
  }
  solve_middle<kLanes, false>(x.number(steps_));
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
