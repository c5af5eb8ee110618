#include "math/soa_field.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "math/simd.h"

namespace bt {

namespace {

typedef double Four __attribute__((vector_size(32)));

}  // namespace

// Eight independent maxima: a single one would be a chain of dependent operations.
BT_VECTOR double largest_of(const double* a, int n) {
  Four most[2] = {}, none[2] = {};
  int i = 0;
  for (; i + 8 <= n; i += 8)
    for (int j = 0; j < 2; ++j) {
      Four v;
      std::memcpy(&v, a + i + 4 * j, sizeof v);
      none[j] += 0 * v;  // NaN if v is not finite
      most[j] = v > most[j] ? v : most[j];
      most[j] = -v > most[j] ? -v : most[j];
    }
  double largest = 0, bad = 0;
  for (int j = 0; j < 8; ++j) {
    largest = std::max(largest, most[j / 4][j % 4]);
    bad += none[j / 4][j % 4];
  }
  for (; i < n; ++i) {
    largest = std::max(largest, std::fabs(a[i]));
    bad += 0 * a[i];
  }
  return largest + bad;
}

void Planes::resize(int planes, int n) {
  n_ = n;
  stride_ = (n + 15) / 8 * 8;
  data_.assign(static_cast<size_t>(planes) * stride_, 0.0);
}

double inner(const Field& a, const Field& b) {
  double sum = 0;
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < a.size(); ++i) sum += a[c][i] * b[c][i];
  return sum;
}

}  // namespace bt
