#include "geometry/primitive_distance.h"

#include <algorithm>
#include <cmath>

#include "math/rounding.h"

namespace bt {

namespace {

// Component of the normal along the axis of a cylinder, below which it is one of its side [-].
constexpr double kOnSide = 1e-3;

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
  const double reach = sum_of(d), rounding = kFormRounding * (sum_of(a) + reach);

  Vec3 at(double u) const { return a + u * d; }

  // Half the slope of the squared distance, which never falls along a segment.
  double slope(double u) const {
    const Vec3 gap = primitive.gap(at(u));
    const double value = dot(gap, d);
    return std::fabs(value) <= reach * (kFormRounding * sum_of(gap) + rounding) ? 0 : value;
  }

  double nearest() const {
    const double low = slope(0), high = slope(1);
    // Flat at both ends: parallel to the surface, so the middle speaks for it.
    if (low == 0 && high == 0 && reach > 0) return 0.5;
    if (low >= 0) return 0;
    if (high <= 0) return 1;
    return root(low, high);
  }

  double nearest_to_axis() const { return -(a.x * d.x + a.y * d.y) / (d.x * d.x + d.y * d.y); }

  // The zero of the slope, which is low < 0 at 0 and high > 0 at 1: by regula falsi with the Illinois rule.
  // It begins at the point that is nearest to the axis, as that is the nearest to the mantle of a cylinder.
  // Every point is strictly between the ends, so that the search ends.
  double root(double low, double high) const {
    double left = 0, right = 1, u = nearest_to_axis();
    int kept = 0;
    if (!(u > 0 && u < 1)) u = low / (low - high);
    for (; right - left >= kFormRounding; u = (left * high - right * low) / (high - low)) {
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

  // Where the core's signed distance, which is convex along a line, is least.
  double deepest() const {
    const double inner = golden_section(0, 1, [&](double u) { return signed_distance(u); });
    double best = 0;
    for (const double w : {1.0, inner})
      if (signed_distance(w) < signed_distance(best)) best = w;
    return best;
  }
};

Primitive::Round Primitive::round_at(Vec3 point, Vec3 normal) const {
  const Vec3 z{0, 0, 1};
  if (kind == Kind::cylinder) return {std::fabs(normal.z) < kOnSide ? radius : 0, z};
  return {growth, std::fabs(point.z) < half.z ? z : Vec3{}};
}

double Primitive::beside_straight(Vec3 point, Vec3 a, Vec3 b) const {
  const Vec3 most = kind == Kind::cylinder ? Vec3{0, 0, half_length} : half;
  double from = 0, to = 1;
  auto clip = [&](double at, double half, double start, double way) {
    if (std::fabs(at) >= half || way == 0) return;
    const double low = (-half - start) / way, high = (half - start) / way;
    from = std::max(from, std::min(low, high));
    to = std::min(to, std::max(low, high));
  };
  clip(point.x, most.x, a.x, b.x - a.x);
  clip(point.y, most.y, a.y, b.y - a.y);
  clip(point.z, most.z, a.z, b.z - a.z);
  return std::max(to - from, 0.0);
}

int Primitive::face_over(Vec3 from, Vec3 to, double beside) const {
  if (!is_flat()) return 0;
  const double start[] = {from.x, from.y, from.z}, end[] = {to.x, to.y, to.z};
  const double most[] = {half.x, half.y, half.z};
  int face = 0;
  for (int k = 0; k < 3; ++k) {
    if (std::fabs(start[k]) <= most[k]) {
      if (std::fabs(end[k]) + beside > most[k]) return 0;
      continue;
    }
    if (face != 0) return 0;
    face = start[k] > 0 ? k + 1 : -(k + 1);
  }
  return face;
}

Primitive::Nearest Primitive::nearest(Vec3 a, Vec3 b) const {
  AlongPrimitive along{*this, a, b - a};
  double u = along.nearest();
  Vec3 normal = gap(along.at(u));
  double size = norm(normal);
  if (size > along.rounding)
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
