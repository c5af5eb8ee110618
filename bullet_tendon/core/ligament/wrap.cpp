#include "ligament/wrap.h"

#include <algorithm>
#include <cmath>

namespace bt {

namespace {

// The way around a circle in the plane of the unit vectors e1, e2: angles from e1 of the tangent points.
struct Arc {
  bool touches = false;
  Vec3 e1, e2;
  double begin = 0, end = 0;     // [rad]
  double before = 0, after = 0;  // lengths of the straight parts [m]
};

// a and b: from the centre, in one plane.
Arc around_circle(Vec3 a, Vec3 b, double radius) {
  Arc arc;
  const double far = norm(a), other = norm(b);
  if (!(far > radius) || !(other > radius)) return arc;
  const Vec3 along = b - a;
  const double share = -dot(a, along) / std::max(dot(along, along), 1e-300);
  if (share <= 0 || share >= 1 || norm(a + share * along) >= radius) return arc;
  arc.e1 = (1 / far) * a;
  arc.e2 = unit_or(b - dot(b, arc.e1) * arc.e1, any_perpendicular(arc.e1));
  const double whole = std::atan2(dot(b, arc.e2), dot(b, arc.e1));
  arc.begin = std::acos(radius / far);
  arc.end = whole - std::acos(radius / other);
  arc.touches = arc.end > arc.begin;
  arc.before = std::sqrt(far * far - radius * radius);
  arc.after = std::sqrt(other * other - radius * radius);
  return arc;
}

Vec3 at_angle(const Arc& arc, double radius, double angle) {
  return radius * (std::cos(angle) * arc.e1 + std::sin(angle) * arc.e2);
}

}  // namespace

Wrapped wrap_around(const Wrap& wrap, const Pose& frame, Vec3 p, Vec3 q) {
  Vec3 a = to_local(frame, p), b = to_local(frame, q);
  const double height = a.z, rise = b.z - a.z;
  const bool cylinder = wrap.shape == WrapShape::cylinder;
  if (cylinder) a.z = b.z = 0;
  const Arc arc = around_circle(a, b, wrap.radius);
  if (!arc.touches) return {};
  Vec3 first = at_angle(arc, wrap.radius, arc.begin), last = at_angle(arc, wrap.radius, arc.end);
  double length = wrap.radius * (arc.end - arc.begin);
  if (cylinder) {
    const double whole = arc.before + length + arc.after;
    first.z = height + rise * arc.before / whole;
    last.z = height + rise * (arc.before + length) / whole;
    length *= std::sqrt(1 + rise * rise / (whole * whole));
  }
  return {true, to_world(frame, first), to_world(frame, last), length};
}

}  // namespace bt
