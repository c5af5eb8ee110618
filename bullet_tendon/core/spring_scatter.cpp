// From springs to particles: residuals and matrices.
#include "springs.h"

namespace bt {

namespace {

// r -= f(k) at the first particle of every spring, r += f(k) at the second.
template <class Force>
BT_WITHIN inline void scatter(double* r, int m, int reach, Force f) {
  const int lo = std::min(m, reach);
  for (int i = 0; i < lo; ++i) r[i] -= f(i);
#pragma GCC ivdep
  for (int i = lo; i < m; ++i) r[i] = (r[i] - f(i)) + f(i - reach);
  for (int i = std::max(m, reach); i < m + reach; ++i) r[i] += f(i - reach);
}

// own w + the blocks b of structure springs.
BT_WITHIN inline void start_diagonal(double* d, const double* w, double own, const double* b, int n) {
  d[0] = own * w[0] + b[0], d[n - 1] = own * w[n - 1] + b[n - 2];
#pragma GCC ivdep
  for (int i = 1; i < n - 1; ++i) d[i] = own * w[i] + b[i] + b[i - 1];
}

// And those of shear springs, s. All at once: what was stored a moment ago and is read again, shifted by a
// few, has the processor wait.
BT_WITHIN inline void start_diagonal(double* d, const double* w, double own, const double* b, const double* s,
                                     int n) {
  auto at = [&](int i) {
    double sum = own * w[i];
    for (int k : {i, i - 1})
      if (k >= 0 && k < n - 1) sum += b[k];
    for (int k : {i, i - 2})
      if (k >= 0 && k < n - 2) sum += s[k];
    return sum;
  };
  for (int i = 0; i < std::min(2, n); ++i) d[i] = at(i);
#pragma GCC ivdep
  for (int i = 2; i < n - 2; ++i) d[i] = own * w[i] + b[i] + b[i - 1] + s[i] + s[i - 2];
  for (int i = std::max(2, n - 2); i < n; ++i) d[i] = at(i);
}

BT_WITHIN inline void start_below(const SpringSet& s, Planes& below) {
  constexpr int kFull[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
  for (int c = 0; c < 9; ++c) {
    const double* b = s.block[kFull[c]];
    double* e = below[c];
#pragma GCC ivdep
    for (int k = 0; k < s.count; ++k) e[k] = -b[k];
  }
}

}  // namespace

BT_VECTOR void scatter_forces(const SpringSet& s, Field& residual) {
  for (int c = 0; c < 3; ++c) {
    const double* f = s.vector[c];
    scatter(residual[c], s.count, s.reach, [=](int k) BT_WITHIN { return f[k]; });
  }
}

BT_VECTOR void start_matrix(const SpringSet& s, const SpringSet& shear, const std::vector<double>& mass,
                            double inverse, Band& matrix) {
  for (int c = 0; c < 6; ++c) {
    const double own = c == 0 || c == 3 || c == 5 ? inverse : 0;
    if (shear.count > 0)
      start_diagonal(matrix.diagonal[c], mass.data(), own, s.block[c], shear.block[c], matrix.n);
    else
      start_diagonal(matrix.diagonal[c], mass.data(), own, s.block[c], matrix.n);
  }
  start_below(s, matrix.below[0]);
  if (shear.count > 0)
    start_below(shear, matrix.below[1]);
  else if (matrix.half == 2)
    matrix.below[1].zero();
}

BT_VECTOR void scatter_blocks(const SpringSet& s, Band& matrix) {
  const int m = s.count, reach = s.reach;
  constexpr int kFull[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
  for (int c = 0; c < 6; ++c) {
    const double* b = s.block[c];
    double* d = matrix.diagonal[c];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) d[k] += b[k];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) d[k + reach] += b[k];
  }
  Planes& off = matrix.below[reach - 1];
  for (int c = 0; c < 9; ++c) {
    const double* b = s.block[kFull[c]];
    double* e = off[c];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) e[k] = (reach == 1 ? e[k] : 0.0) - b[k];
  }
}

BT_VECTOR void scatter_linearisation(const SpringSet& s, const Law& law, Field& right_hand) {
  if (is_linear(law)) return;
  for (int c = 0; c < 3; ++c) {
    const double *n = s.direction[c], *linear = s.linear.data(), *truth = s.true_elastic.data();
    scatter(right_hand[c], s.count, s.reach, [=](int k) BT_WITHIN { return (linear[k] - truth[k]) * n[k]; });
  }
}

}  // namespace bt
