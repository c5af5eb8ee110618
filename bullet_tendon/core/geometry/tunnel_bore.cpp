#include "geometry/tunnel_bore.h"

#include <algorithm>
#include <cmath>

#include "math/rounding.h"

namespace bt {

double Bore::leaves(Vec3 a, Vec3 b) const {
  const double z = along(a), rise = dot(b - a, axis);
  double share = 1;
  if (rise > 0) share = std::min(share, (length - z) / rise);
  if (rise < 0) share = std::min(share, -z / rise);
  // |p + s d| = R, of the parts across the axis.
  const Vec3 p = without(a - start, axis), d = without(b - a, axis);
  const double dd = dot(d, d), pd = dot(p, d), room = radius * radius - dot(p, p);
  if (dd > 0) share = std::min(share, (std::sqrt(std::max(0.0, pd * pd + dd * room)) - pd) / dd);
  return std::max(0.0, share);
}

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
  auto square = [&](double u) { return to_circle(a, d, u, centre, axis, radius); };
  // Intervals between samples [-]. Fewer: the nearer one of two minima may be missed. More: slower.
  constexpr int kSamples = 8;
  int best = 0;
  double least = square(0);
  for (int s = 1; s <= kSamples; ++s) {
    const double value = square(static_cast<double>(s) / kSamples);
    if (value < least) {
      least = value;
      best = s;
    }
  }
  const double left = std::max(0, best - 1) / static_cast<double>(kSamples);
  const double right = std::min(kSamples, best + 1) / static_cast<double>(kSamples);
  const double u = golden_section(left, right, square);
  return u < 1e-7 ? 0 : u > 1 - 1e-7 ? 1 : u;
}

}  // namespace bt
