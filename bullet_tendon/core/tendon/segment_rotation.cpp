// Segments that rotate within an iteration.
//
// A linear solution moves particles along straight lines. Therefore a segment of length l that rotates by
// the angle phi becomes l phi^2 / 2 too long. In a stiff tendon this is nearly all of the next residual,
// because a micrometre changes the force by newtons. Here each segment gets the length of the linear
// solution, m = l + u.d with d = d_k+1 - d_k, in its new direction e. Its length |e| is too large by
//
//   |e| - m = |d - (u.d) u|^2 / (|e| + m).
//
// This form has no cancellation; the difference of the two lengths would end as rounding noise. The
// corrections are summed along the tendon, starting at its anchors. Between two anchors the closing error is
// distributed evenly. The correction is of second order in the solution: it changes the speed of convergence
// of Newton's method, but not its fixed point.
#include <algorithm>
#include <cmath>

#include "tendon/tendon.h"

namespace bt {

namespace {

// Computes the shift of the end of each segment relative to its start [m].
BT_VECTOR void measure_shifts(const Tendon& c, Field& shift) {
  const SpringSet& s = c.structure;
  const double *x = c.x[0], *y = c.x[1], *z = c.x[2];
  const double *tx = c.displacement[0], *ty = c.displacement[1], *tz = c.displacement[2];
  const double *dx = c.dx[0], *dy = c.dx[1], *dz = c.dx[2];
  const double *ux = s.direction[0], *uy = s.direction[1], *uz = s.direction[2], *length = s.length.data();
  double *sx = shift[0], *sy = shift[1], *sz = shift[2];
  sx[0] = sy[0] = sz[0] = 0;
#pragma GCC ivdep
  for (int k = 0; k < s.count; ++k) {
    const double ex = x[k + 1] - x[k] + (tx[k + 1] - tx[k]), ey = y[k + 1] - y[k] + (ty[k + 1] - ty[k]),
                 ez = z[k + 1] - z[k] + (tz[k + 1] - tz[k]);
    const double ax = dx[k + 1] - dx[k], ay = dy[k + 1] - dy[k], az = dz[k + 1] - dz[k];
    const double along = ux[k] * ax + uy[k] * ay + uz[k] * az, meant = length[k] + along;
    const double px = ax - along * ux[k], py = ay - along * uy[k], pz = az - along * uz[k];
    const double now = std::sqrt(ex * ex + ey * ey + ez * ez), across = px * px + py * py + pz * pz;
    // A reversed or collapsed segment is not corrected.
    const double factor = meant > 0 && now > 0 ? -across / (now * (now + meant)) : 0;
    sx[k + 1] = factor * ex;
    sy[k + 1] = factor * ey;
    sz[k + 1] = factor * ez;
  }
}

void sum_up(Field& shift) {
  for (int k = 0; k < 3; ++k) {
    double* s = shift[k];
    for (int i = 1; i < shift.size(); ++i) s[i] += s[i - 1];
  }
}

// Moves the particles from..to-1 by their shifts, less `base` and less a share of `change` that grows
// linearly from 0 at `from` to 1 at `to`.
void shift_span(Tendon& c, const Field& shift, int from, int to, Vec3 base, Vec3 change) {
  const double share = to > from ? 1.0 / (to - from) : 0;
  for (int i = from; i < to; ++i) c.move(i, shift.at(i) - base - ((i - from) * share) * change);
}

// Mean shift weighted by mass. Without anchors it is subtracted, so that the centre of mass does not move.
Vec3 mean_shift(const Tendon& c, const Field& shift) {
  Vec3 sum;
  double mass = 0;
  for (int i = 0; i < c.n(); ++i) {
    sum += c.mass[i] * shift.at(i);
    mass += c.mass[i];
  }
  return (1 / mass) * sum;
}

}  // namespace

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

void keep_lengths(Tendon& c) {
  Field& shift = c.residual;  // free to reuse: this iteration no longer needs it
  measure_shifts(c, shift);
  sum_up(shift);
  int last = -1;  // previous particle with an anchor, and its shift `base`
  Vec3 base;
  for (int i = 0; i < c.n(); ++i) {
    const auto anchors = [i](const Anchor& h) { return h.particle == i; };
    if (std::none_of(c.anchors.begin(), c.anchors.end(), anchors)) continue;
    const Vec3 here = shift.at(i);
    if (last < 0)
      shift_span(c, shift, 0, i, here, {});
    else
      shift_span(c, shift, last, i, base, here - base);
    last = i;
    base = here;
  }
  if (last < 0) base = mean_shift(c, shift);
  shift_span(c, shift, std::max(last, 0), c.n(), base, {});
}

}  // namespace bt
