#include "geometry/primitive_distance.h"

#include <algorithm>
#include <cmath>

namespace bt {

namespace {

// Of closed forms (geometry/primitive_distance.h): cosine between a segment and the way to it up to which it
// is parallel to the surface; rounding of a place, and what a distance has to exceed to be one, as shares of
// coordinates [-]. Larger: what is slanted, or a little way off, is taken for flat, or touching. Smaller:
// rounding decides.
constexpr double kParallel = 1e-14;
constexpr double kLineRounding = 2e-16;
constexpr double kOnSurface = 1e-15;
// Steps and widths at which searches along a segment end [-]. Fewer, or wider: nearest points are off. More,
// or narrower: rounding is searched for.
constexpr int kRootSteps = 60;
constexpr double kRootWidth = 1e-15, kDeepestWidth = 1e-9;
constexpr double kGolden = 0.6180339887498949;

double beyond(double x, double half) { return x > half ? x - half : x < -half ? x + half : 0; }
double sum_of(Vec3 v) { return std::fabs(v.x) + std::fabs(v.y) + std::fabs(v.z); }

}  // namespace

Vec3 Primitive::gap(Vec3 x) const {
  if (kind == Kind::box) return {beyond(x.x, half.x), beyond(x.y, half.y), beyond(x.z, half.z)};
  const double rho = std::sqrt(x.x * x.x + x.y * x.y), share = rho > radius ? 1 - radius / rho : 0;
  return {x.x * share, x.y * share, beyond(x.z, half_length)};
}

double Primitive::inside(Vec3 x, Vec3& normal) const {
  const double z = half_length - std::fabs(x.z);
  if (kind == Kind::cylinder) {
    const double rho = std::sqrt(x.x * x.x + x.y * x.y);
    if (z < radius - rho) return normal = {0, 0, std::copysign(1.0, x.z)}, -z;
    normal = rho > 0 ? Vec3{x.x / rho, x.y / rho, 0} : Vec3{1, 0, 0};
    return rho - radius;
  }
  const Vec3 depth{half.x - std::fabs(x.x), half.y - std::fabs(x.y), half.z - std::fabs(x.z)};
  const double least = std::min({depth.x, depth.y, depth.z});
  if (least == depth.x)
    normal = {std::copysign(1.0, x.x), 0, 0};
  else if (least == depth.y)
    normal = {0, std::copysign(1.0, x.y), 0};
  else
    normal = {0, 0, std::copysign(1.0, x.z)};
  return -least;
}

// On the segment a + u d.
struct AlongPrimitive {
  const Primitive& primitive;
  const Vec3 a, d;
  const double reach = sum_of(d), rounding = kLineRounding * (sum_of(a) + reach);

  Vec3 at(double u) const { return a + u * d; }

  // Half the slope of the squared distance, which never falls along a segment.
  double slope(double u) const {
    const Vec3 gap = primitive.gap(at(u));
    const double value = dot(gap, d);
    return std::fabs(value) <= reach * (kParallel * sum_of(gap) + rounding) ? 0 : value;
  }

  double nearest() const {
    const double low = slope(0), high = slope(1);
    // Flat at both ends: parallel to the surface, so the middle speaks for it.
    if (low == 0 && high == 0 && reach > 0) return 0.5;
    if (low >= 0) return 0;
    if (high <= 0) return 1;
    return root(low, high);
  }

  // The zero of the slope, which is low < 0 at 0 and high > 0 at 1: regula falsi with the Illinois rule.
  double root(double low, double high) const {
    double left = 0, right = 1, u = 0;
    int kept = 0;
    for (int step = 0; step < kRootSteps && right - left >= kRootWidth; ++step) {
      u = (left * high - right * low) / (high - low);
      const double value = slope(u);
      if (value == 0) break;
      if (value < 0) {
        high = kept < 0 ? 0.5 * high : high;
        kept = -1;
        left = u;
        low = value;
      } else {
        low = kept > 0 ? 0.5 * low : low;
        kept = 1;
        right = u;
        high = value;
      }
    }
    return u;
  }

  double signed_distance(double u) const {
    Vec3 normal;
    const double size = norm(primitive.gap(at(u)));
    return size > 0 ? size : primitive.inside(at(u), normal);
  }

  // Golden section on the core's signed distance, which is convex along a line.
  double deepest() const {
    double left = 0, right = 1;
    while (right - left > kDeepestWidth) {
      const double u = right - kGolden * (right - left), v = left + kGolden * (right - left);
      if (signed_distance(u) <= signed_distance(v))
        right = v;
      else
        left = u;
    }
    double best = 0;
    for (const double w : {1.0, 0.5 * (left + right)})
      if (signed_distance(w) < signed_distance(best)) best = w;
    return best;
  }
};

Primitive::Nearest Primitive::nearest(Vec3 a, Vec3 b) const {
  const AlongPrimitive along{*this, a, b - a};
  double u = along.nearest();
  Vec3 normal = gap(along.at(u));
  double size = norm(normal);
  if (size > kOnSurface * (sum_of(a) + along.reach))
    normal = (1 / size) * normal;
  else  // it touches, as far as rounding can tell, or runs through
  {
    u = along.deepest();
    size = inside(along.at(u), normal);
  }
  const double distance = size - growth;
  return {distance, along.at(u) - distance * normal, u};
}

}  // namespace bt
