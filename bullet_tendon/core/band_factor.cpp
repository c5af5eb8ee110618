// The factorisation and solution of band.h.
#include <algorithm>

#include "band.h"

namespace bt {

namespace {

inline Lanes both(const double* plane, int top, int bottom) { return Lanes{plane[top], plane[bottom]}; }

// Six planes of the diagonal blocks `top` and `bottom`.
inline void load_diagonal(const Planes& d, int top, int bottom, Lanes* out) {
  for (int c = 0; c < 6; ++c) out[c] = both(d[c], top, bottom);
}

// The block that couples a pivot with the one `offset` further in: A(top+offset, top) in lane 0,
// A(bottom-offset, bottom) = A(bottom, bottom-offset)^T in lane 1.
inline void load_coupling(const Planes& below, int top, int bottom, int offset, Lanes* out) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      out[3 * r + c] = Lanes{below[3 * r + c][top], below[3 * c + r][bottom - offset]};
}

// xx xy xz yy yz zz -> l21 l31 l32 1/d1 1/d2 1/d3; the pivots d are returned for the sign test.
inline bool ldl(const Lanes* a, Lanes* f) {
  Lanes i1 = 1.0 / a[0];
  Lanes l21 = a[1] * i1, l31 = a[2] * i1;
  Lanes d2 = a[3] - l21 * a[1];
  Lanes i2 = 1.0 / d2;
  Lanes e = a[4] - l21 * a[2];
  Lanes l32 = e * i2;
  Lanes d3 = a[5] - l31 * a[2] - l32 * e;
  f[0] = l21, f[1] = l31, f[2] = l32, f[3] = i1, f[4] = i2, f[5] = 1.0 / d3;
  return a[0][0] > 0 && a[0][1] > 0 && d2[0] > 0 && d2[1] > 0 && d3[0] > 0 && d3[1] > 0;
}

inline void ldl_solve(const Lanes* f, Lanes& x, Lanes& y, Lanes& z) {
  y -= f[0] * x;
  z -= f[1] * x + f[2] * y;
  x *= f[3], y *= f[4], z *= f[5];
  y -= f[2] * z;
  x -= f[0] * y + f[1] * z;
}

// Half the way to Z = D^-1 E^T: W = L^-1 E^T and diag^-1 W. Products E Z' are W^T diag^-1 W', for which
// the next pivot does not have to wait for Z.
struct Half {
  Lanes w[9], scaled[9];
};

inline void solve_half(const Lanes* f, const Lanes* e, Half& h) {
  for (int c = 0; c < 3; ++c) {
    const Lanes x = e[3 * c], y = e[3 * c + 1] - f[0] * x, z = e[3 * c + 2] - (f[1] * x + f[2] * y);
    h.w[c] = x, h.w[3 + c] = y, h.w[6 + c] = z;
    h.scaled[c] = x * f[3], h.scaled[3 + c] = y * f[4], h.scaled[6 + c] = z * f[5];
  }
}

// Z = L^-T diag^-1 W.
inline void solve_rest(const Lanes* f, const Half& h, Lanes* z) {
  for (int c = 0; c < 3; ++c) {
    const Lanes last = h.scaled[6 + c], y = h.scaled[3 + c] - f[2] * last;
    z[c] = h.scaled[c] - (f[0] * y + f[1] * last), z[3 + c] = y, z[6 + c] = last;
  }
}

inline Lanes product(const Half& e, int r, const Half& z, int c) {
  return e.w[r] * z.scaled[c] + e.w[3 + r] * z.scaled[3 + c] + e.w[6 + r] * z.scaled[6 + c];
}

// The six distinct entries of E Z, which is symmetric.
inline void symmetric_product(const Half& h, Lanes* out) {
  out[0] = product(h, 0, h, 0), out[1] = product(h, 0, h, 1), out[2] = product(h, 0, h, 2);
  out[3] = product(h, 1, h, 1), out[4] = product(h, 1, h, 2), out[5] = product(h, 2, h, 2);
}

}  // namespace

void BandFactor::resize(int blocks, int half_bandwidth) {
  n_ = blocks, half_ = half_bandwidth;
  middle_ = half_ == 1 ? (n_ % 2 ? 1 : 2) : (n_ % 2 ? 3 : 2);
  if (middle_ > n_) middle_ = n_;
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
  for (int c = 0; c < 6; ++c) left_[0][c] = first[c], left_[1][c] = second[c];
  for (int c = 0; c < 9; ++c) left_[2][c] = between[c];
  return ok;
}

bool BandFactor::factorise_middle(const Band& a) {
  constexpr int kFull[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
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
    take(0, 0, left_[0]), take(w - 1, 1, left_[0]);
    if (half_ == 2) {
      take(1, 0, left_[1]), take(w - 2, 1, left_[1]);
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
    for (int k = 0; k < j; ++k) scaled[k] = at(j, k) * pivot[k], d -= at(j, k) * scaled[k];
    ok &= d > 0;
    pivot[j] = d, at(j, j) = 1 / d;
    for (int i = j + 1; i < m; ++i) {
      double v = at(i, j);
      for (int k = 0; k < j; ++k) v -= at(i, k) * scaled[k];
      at(i, j) = v * at(j, j);
    }
  }
  return ok;
}

void BandFactor::solve(const Field& b, Field& x, int first, int last) const {
  const int to = std::min(first, n_ - 1 - last);
  half_ == 1 ? solve_ends<1>(b, x, to) : solve_ends<2>(b, x, to);
}

// Back from the middle to the steps `to` of both ends.
template <int H>
void BandFactor::solve_ends(const Field& b, Field& x, int to) const {
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
    ldl_solve(p.ldl, z[0], z[1], z[2]);
    for (int c = 0; c < 3; ++c) x[c][top] = z[c][0], x[c][bottom] = z[c][1];
  }
  double y[9];
  const int w = middle_;
  for (int i = 0; i < w; ++i)
    for (int c = 0; c < 3; ++c) y[3 * i + c] = b[c][steps_ + i];
  for (int c = 0; c < 3; ++c) {
    y[c] -= first[c][0], y[3 * (w - 1) + c] -= first[c][1];
    if (H == 2 && steps_ > 0) y[3 + c] -= second[c][0], y[3 * (w - 2) + c] -= second[c][1];
  }
  solve_middle<1>(y);
  for (int i = 0; i < w; ++i)
    for (int c = 0; c < 3; ++c) x[c][steps_ + i] = y[3 * i + c];
  for (int s = steps_ - 1; s >= to; --s) {
    const Pivot& p = pivots_[s];
    const int top = s, bottom = n_ - 1 - s;
    for (int o = 0; o < H; ++o) {
      Lanes v[3];
      for (int c = 0; c < 3; ++c) v[c] = both(x[c], top + o + 1, bottom - o - 1);
      for (int r = 0; r < 3; ++r) {
        Lanes sum = p.z[o][3 * r] * v[0] + p.z[o][3 * r + 1] * v[1] + p.z[o][3 * r + 2] * v[2];
        x[r][top] -= sum[0], x[r][bottom] -= sum[1];
      }
    }
  }
}

}  // namespace bt
