#include "band.h"

namespace bt {

namespace {
constexpr int kFull[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};  // plane of entry (row, column) of a symmetric block

// P M Q for a row-major 3x3, one side at a time.
void project_left(double* m, const Sym3& N) {
  for (int c = 0; c < 3; ++c) {
    Vec3 v{m[c], m[3 + c], m[6 + c]};
    v -= N * v;
    m[c] = v.x, m[3 + c] = v.y, m[6 + c] = v.z;
  }
}
void project_right(double* m, const Sym3& N) {
  for (int r = 0; r < 3; ++r) {
    Vec3 v{m[3 * r], m[3 * r + 1], m[3 * r + 2]};
    v -= N * v;
    m[3 * r] = v.x, m[3 * r + 1] = v.y, m[3 * r + 2] = v.z;
  }
}
}  // namespace

void Band::resize(int blocks, int half_bandwidth) {
  n = blocks, half = half_bandwidth;
  diagonal.resize(6, n);
  for (int o = 0; o < 2; ++o) below[o].resize(o < half ? 9 : 0, n);
}

void Band::zero() {
  diagonal.zero();
  for (int o = 0; o < half; ++o) below[o].zero();
}

Sym3 Band::block(int i) const {
  return {diagonal[0][i], diagonal[1][i], diagonal[2][i], diagonal[3][i], diagonal[4][i], diagonal[5][i]};
}

void Band::add(int i, const Sym3& b) {
  const double v[6] = {b.xx, b.xy, b.xz, b.yy, b.yz, b.zz};
  for (int c = 0; c < 6; ++c) diagonal[c][i] += v[c];
}

void Band::add_below(int i, int offset, double w, const Sym3& b) {
  const double v[6] = {b.xx, b.xy, b.xz, b.yy, b.yz, b.zz};
  for (int c = 0; c < 9; ++c) below[offset - 1][c][i] += w * v[kFull[c]];
}

void Band::add_below(int i, double w, Vec3 p, Vec3 q) {
  const double rows[3] = {p.x, p.y, p.z}, columns[3] = {q.x, q.y, q.z};
  for (int c = 0; c < 9; ++c) below[0][c][i] += w * rows[c / 3] * columns[c % 3];
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
  double m[9];
  for (int c = 0; c < 9; ++c) m[c] = diagonal[kFull[c]][i];
  project_left(m, N), project_right(m, N);
  const double kept[6] = {m[0] + N.xx, m[1] + N.xy, m[2] + N.xz, m[4] + N.yy, m[5] + N.yz, m[8] + N.zz};
  for (int c = 0; c < 6; ++c) diagonal[c][i] = kept[c];
  for (int o = 0; o < half; ++o) {
    int after = i, before = i - o - 1;
    if (after + o + 1 < n) {
      for (int c = 0; c < 9; ++c) m[c] = below[o][c][after];
      project_right(m, N);
      for (int c = 0; c < 9; ++c) below[o][c][after] = m[c];
    }
    if (before >= 0) {
      for (int c = 0; c < 9; ++c) m[c] = below[o][c][before];
      project_left(m, N);
      for (int c = 0; c < 9; ++c) below[o][c][before] = m[c];
    }
  }
}

}  // namespace bt
