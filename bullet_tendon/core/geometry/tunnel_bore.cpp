#include "geometry/tunnel_bore.h"

#include <algorithm>

namespace bt {

Vec3 nearest_on_circle(Vec3 p, Vec3 centre, Vec3 axis, double radius, Vec3 fallback) {
  return centre + radius * unit_or(without(p - centre, axis), fallback);
}

namespace {

// Squared distance to the circle of the point at parameter u:
//   D(u) = (rho(u) - R)^2 + z(u)^2, rho the distance from the axis, z the height over the plane.
double to_circle(Vec3 a, Vec3 d, double u, Vec3 centre, Vec3 axis, double radius) {
  Vec3 p = a + u * d - centre;
  double z = dot(p, axis), rho = norm(without(p, axis));
  return (rho - radius) * (rho - radius) + z * z;
}

}  // namespace

double nearest_to_circle(Vec3 a, Vec3 b, Vec3 centre, Vec3 axis, double radius) {
  const Vec3 d = b - a;
  constexpr int kSamples = 8;
  int best = 0;
  double least = to_circle(a, d, 0, centre, axis, radius);
  for (int s = 1; s <= kSamples; ++s) {
    double value = to_circle(a, d, static_cast<double>(s) / kSamples, centre, axis, radius);
    if (value < least) {
      least = value;
      best = s;
    }
  }
  double lo = std::max(0, best - 1) / static_cast<double>(kSamples);
  double hi = std::min(kSamples, best + 1) / static_cast<double>(kSamples);
  constexpr double kGolden = 0.6180339887498949;
  for (int i = 0; i < 36; ++i) {  // golden section: 1e-8 of a segment, where D is flat anyway
    double u = hi - kGolden * (hi - lo), w = lo + kGolden * (hi - lo);
    if (to_circle(a, d, u, centre, axis, radius) < to_circle(a, d, w, centre, axis, radius))
      hi = w;
    else
      lo = u;
  }
  double u = 0.5 * (lo + hi);
  return u < 1e-7 ? 0 : u > 1 - 1e-7 ? 1 : u;
}

}  // namespace bt
