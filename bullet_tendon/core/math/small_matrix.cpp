#include "math/small_matrix.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "math/rounding.h"
#include "math/simd.h"

namespace bt {

namespace dense {

namespace {

// y += A^T x, where the rows of A have n numbers.
template <class Size>
inline void add_rows(Size n, int rows, const double* a, const double* x, double* __restrict y) {
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < n; ++j) y[j] += a[i * n + j] * x[i];
}

}  // namespace

void set_identity(int n, Numbers& a) {
  a.assign(static_cast<size_t>(n) * n, 0.0);
  for (int i = 0; i < n; ++i) a[i * n + i] = 1;
}

void multiply(const Numbers& a, const Numbers& x, Numbers& y) {
  of_size(static_cast<int>(x.size()), [&](auto n) {
    const int rows = n ? static_cast<int>(a.size()) / n : 0;
    y.resize(rows);
    const double *from = a.data(), *of = x.data();
    double* __restrict to = y.data();
    for (int i = 0; i < rows; ++i) {
      double sum = 0;
      for (int j = 0; j < n; ++j) sum += from[i * n + j] * of[j];
      to[i] = sum;
    }
  });
}

void multiply_transposed(const Numbers& a, const Numbers& x, Numbers& y) {
  const int rows = static_cast<int>(x.size());
  of_size(rows ? static_cast<int>(a.size()) / rows : 0, [&](auto n) {
    y.assign(n, 0.0);
    add_rows(n, rows, a.data(), x.data(), y.data());
  });
}

void add_rows(const Numbers& a, int rows, const double* x, Numbers& y) {
  of_size(static_cast<int>(y.size()), [&](auto n) { add_rows(n, rows, a.data(), x, y.data()); });
}

void subtract_product(int size, const Numbers& a, const Numbers& b, Numbers& c) {
  const int rows = static_cast<int>(c.size()) / size, inner = static_cast<int>(b.size()) / size;
  of_size(size, [&](auto n) {
    double* __restrict to = c.data();
    for (int i = 0; i < rows; ++i)
      for (int k = 0; k < inner; ++k)
        for (int j = 0; j < n; ++j) to[i * n + j] -= a[i * inner + k] * b[k * n + j];
  });
}

void product_transposed(int size, const Numbers& a, const Numbers& b, Numbers& c) {
  of_size(size, [&](auto n) {
    const int rows = static_cast<int>(a.size()) / n, columns = static_cast<int>(b.size()) / n;
    c.resize(static_cast<size_t>(rows) * columns);
    double* __restrict to = c.data();
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) {
        double sum = 0;
        for (int k = 0; k < n; ++k) sum += a[i * n + k] * b[j * n + k];
        to[i * columns + j] = sum;
      }
  });
}

void product(int size, const Numbers& a, const Numbers& b, Numbers& c) {
  const int rows = static_cast<int>(a.size()) / size;
  c.assign(a.size(), 0.0);
  of_size(size, [&](auto n) {
    for (int i = 0; i < rows; ++i) add_rows(n, n, b.data(), a.data() + i * n, c.data() + i * n);
  });
}

namespace {

// The transposed factor, in the upper triangle of l: in its rows, the numbers of a step of the elimination
// are neighbours. end: by row, where its numbers that are not zero end, and first: by column, where they
// begin; unless both are null.
template <class Size>
BT_WITHIN inline void eliminate_rows(Size n, const double* a, double* __restrict l, int* end, int* first) {
  for (int j = 0; j < n; ++j) {
    double* row = l + j * n;
    int to_row = n;
    while (end && to_row > j + 1 && a[j * n + to_row - 1] == 0) --to_row;
    for (int i = j; i < to_row; ++i) row[i] = a[j * n + i];
    for (int k = first ? first[j] : 0; k < j; ++k) {
      const double* above = l + k * n;
      const double share = above[j];
      const int to = end ? end[k] : static_cast<int>(n);
      if (end && share == 0) continue;
      to_row = std::max(to_row, to);
#pragma GCC ivdep
      for (int i = j; i < to; ++i) row[i] -= above[i] * share;
    }
    const bool is_zero = !(row[j] > kFormRounding * a[j * n + j]);
    const double d = is_zero ? 1 : std::sqrt(row[j]);
    for (int i = j; i < to_row; ++i) row[i] = is_zero ? 0 : row[i] / d;
    row[j] = is_zero ? 0 : d;
    if (!end) continue;
    end[j] = to_row;
    while (end[j] > j && row[end[j] - 1] == 0) --end[j];
    for (int i = end[j] - 1; i > j && first[i] > j; --i) first[i] = j;
  }
}

// Puts the factor below the diagonal, and zeros above it. end: as above.
template <class Size>
inline void transpose(Size n, double* l, const int* end) {
  for (int k = 0; k < n; ++k) {
    for (int i = k + 1; i < (end ? end[k] : n); ++i) {
      l[i * n + k] = l[k * n + i];
      l[k * n + i] = 0;
    }
  }
}

BT_VECTOR void eliminate(int n, const double* a, double* l) {
  static thread_local std::vector<int> end, first;  // keep their memory
  end.resize(n);
  first.resize(n);
  std::iota(first.begin(), first.end(), 0);
  std::fill(l, l + static_cast<size_t>(n) * n, 0.0);
  eliminate_rows(n, a, l, end.data(), first.data());
  transpose(n, l, end.data());
}

void eliminate(std::integral_constant<int, 6> rigid, const double* a, double* l) {
  eliminate_rows(rigid, a, l, nullptr, nullptr);
  transpose(rigid, l, nullptr);
}

}  // namespace

void root(int size, const Numbers& a, Numbers& l) {
  l.resize(a.size());
  of_size(size, [&](auto n) { eliminate(n, a.data(), l.data()); });
}

void forward(const Numbers& l, Numbers& x) {
  const int n = static_cast<int>(x.size());
  for (int i = 0; i < n; ++i) {
    const double* row = l.data() + i * n;
    int k = 0;
    while (k < i && row[k] == 0) ++k;
    for (; k < i; ++k) x[i] -= row[k] * x[k];
    x[i] = row[i] > 0 ? x[i] / row[i] : 0;
  }
}

void forward_rows(const Numbers& l, int size, Numbers& b) {
  const int m = size ? static_cast<int>(b.size()) / size : 0;
  of_size(size, [&](auto n) {
    for (int i = 0; i < m; ++i) {
      const double pivot = l[i * m + i], scale = pivot > 0 ? 1 / pivot : 0;
      double* __restrict row = b.data() + i * n;
      for (int k = 0; k < i; ++k)
        for (int j = 0; j < n; ++j) row[j] -= l[i * m + k] * b[k * n + j];
      for (int j = 0; j < n; ++j) row[j] *= scale;
    }
  });
}

void solve(const Numbers& l, Numbers& x) {
  const int n = static_cast<int>(x.size());
  forward(l, x);
  for (int i = n - 1; i >= 0; --i) {
    const double* row = l.data() + i * n;
    x[i] = row[i] > 0 ? x[i] / row[i] : 0;
    for (int k = 0; k < i; ++k) x[k] -= row[k] * x[i];
  }
}

void respond(const Numbers& e, const Numbers& w, Numbers& half, Numbers& a) {
  multiply_transposed(e, w, half);
  multiply(e, half, a);
}

namespace {

// A rotation that makes a[p][q] zero.
void rotate(int n, Numbers& a, Numbers& u, int p, int q) {
  const double off = a[p * n + q];
  const double theta = (a[q * n + q] - a[p * n + p]) / (2 * off);
  const double t = (theta < 0 ? -1 : 1) / (std::fabs(theta) + std::sqrt(theta * theta + 1));
  const double c = 1 / std::sqrt(t * t + 1), s = t * c;
  auto mix = [c, s](double& x, double& y) {
    const double before = x;
    x = c * before - s * y;
    y = s * before + c * y;
  };
  for (int k = 0; k < n; ++k) mix(a[k * n + p], a[k * n + q]);
  for (int k = 0; k < n; ++k) {
    mix(a[p * n + k], a[q * n + k]);
    mix(u[k * n + p], u[k * n + q]);
  }
  a[p * n + q] = a[q * n + p] = 0;
}

}  // namespace

// Jacobi's method. Every rotation reduces the sum of the squares of the off-diagonal entries by 2 a_pq^2. The
// sweeps end when all are rounding errors of the largest entry, after four to six, because the method
// converges quadratically.
void eigen(int n, Numbers& a, Numbers& u) {
  set_identity(n, u);
  double largest = 0;
  for (double v : a) largest = std::max(largest, std::fabs(v));
  const double least = std::numeric_limits<double>::epsilon() * largest;
  bool turned = true;
  while (turned) {
    turned = false;
    for (int p = 0; p < n; ++p)
      for (int q = p + 1; q < n; ++q)
        if (std::fabs(a[p * n + q]) > least) {
          rotate(n, a, u, p, q);
          turned = true;
        }
  }
}

double dot(const Numbers& a, const Numbers& b) {
  double sum = 0;
  of_size(static_cast<int>(a.size()), [&](auto n) {
    for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  });
  return sum;
}

void add(Numbers& y, double s, const Numbers& x) {
  for (size_t i = 0; i < x.size(); ++i) y[i] += s * x[i];
}

double inverse_square(const Numbers& l, const Numbers& x, Numbers& half) {
  half.assign(x.begin(), x.end());
  forward(l, half);
  return dot(half, half);
}

}  // namespace dense

Sym3 positive_part(const Sym3& s) {
  dense::Numbers a{s.xx, s.xy, s.xz, s.xy, s.yy, s.yz, s.xz, s.yz, s.zz}, u;
  dense::eigen(3, a, u);
  Sym3 sum;
  for (int k = 0; k < 3; ++k) sum += std::max(0.0, a[4 * k]) * outer({u[k], u[3 + k], u[6 + k]});
  return sum;
}

}  // namespace bt
