#include "tendon/segment_rotation.h"

#include <algorithm>
#include <cmath>

namespace bt {

BT_VECTOR double greatest_turn(const Tendon& c) {
  const double *x = c.x[0], *y = c.x[1], *z = c.x[2];
  const double *nx = c.x_new[0], *ny = c.x_new[1], *nz = c.x_new[2];
  double most = 0;
#pragma GCC ivdep
  for (int k = 0; k + 1 < c.n(); ++k) {
    const double dx = x[k + 1] - x[k], dy = y[k + 1] - y[k], dz = z[k + 1] - z[k];
    const double ex = nx[k + 1] - nx[k], ey = ny[k + 1] - ny[k], ez = nz[k + 1] - nz[k];
    const double a = dy * ez - dz * ey, b = dz * ex - dx * ez, d = dx * ey - dy * ex;
    const double ahead = dx * ex + dy * ey + dz * ez, sine = a * a + b * b + d * d;
    most = std::max(most, sine > 0 ? sine / (sine + ahead * ahead) : 0.0);
  }
  return std::sqrt(most);
}

}  // namespace bt
