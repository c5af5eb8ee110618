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

// An ellipsoid is a sphere once its axes are scaled to 1. Straight lines and tangents stay what they are.
Vec3 scaled(Vec3 a, Vec3 radii) { return {a.x / radii.x, a.y / radii.y, a.z / radii.z}; }
Vec3 unscaled(Vec3 a, Vec3 radii) { return {a.x * radii.x, a.y * radii.y, a.z * radii.z}; }

constexpr int kPlanes = 8;          // in which a way is sought
constexpr int kChords = 8;          // that estimate the length of a geodesic
constexpr double kMostKink = 1e-9;  // sine, beyond which a geodesic nearby was no good guess

// The way along an arc of the scaled sphere, about a centre, on the ellipsoid.
Geodesic along_arc(const Arc& arc, Vec3 centre, double radius, Vec3 p, Vec3 radii) {
  Geodesic way;
  way.start = unscaled(centre + at_angle(arc, radius, arc.begin), radii);
  way.direction = unit_or(way.start - p, any_perpendicular(way.start));
  Vec3 before = way.start;
  for (int i = 1; i <= kChords; ++i) {
    const double angle = arc.begin + (arc.end - arc.begin) * i / kChords;
    const Vec3 at = unscaled(centre + at_angle(arc, radius, angle), radii);
    way.length += norm(at - before);
    before = at;
  }
  return way;
}

// The shortest of the ways from p to q that lie in planes: each cuts a circle from the scaled sphere, and
// goes around it on both sides.
Geodesic shortest_in_planes(Vec3 p, Vec3 q, Vec3 radii) {
  const Vec3 a = scaled(p, radii), b = scaled(q, radii), along = unit_or(b - a, {1, 0, 0});
  const Vec3 aside = any_perpendicular(along), third = cross(along, aside);
  Geodesic best;
  double least = HUGE_VAL;
  for (int k = 0; k < kPlanes; ++k) {
    const double turn = M_PI * k / kPlanes;
    const Vec3 n = std::cos(turn) * aside + std::sin(turn) * third, centre = dot(a, n) * n;
    const double radius = std::sqrt(std::max(0.0, 1 - dot(centre, centre)));
    Arc arc = around_circle(a - centre, b - centre, radius);
    if (!arc.touches) continue;
    for (int side = 0; side < 2; ++side) {
      if (side == 1) {  // around the other side
        arc.e2 = -arc.e2;
        arc.end = 2 * M_PI - arc.end - 2 * std::acos(radius / norm(b - centre));
      }
      const Geodesic way = along_arc(arc, centre, radius, p, radii);
      const Vec3 last = unscaled(centre + at_angle(arc, radius, arc.end), radii);
      const double length = norm(way.start - p) + way.length + norm(q - last);
      if (!(length < least)) continue;
      least = length;
      best = way;
    }
  }
  return best;
}

Vec3 weights_of(const Wrap& wrap) {
  auto inverse = [](double a) { return 1 / (a * a); };
  return {inverse(wrap.radii.x), inverse(wrap.radii.y),
          wrap.shape == WrapShape::cylinder ? 0 : inverse(wrap.radii.z)};
}

Wrapped around_ellipsoid(const Wrap& wrap, const Pose& frame, Vec3 a, Vec3 b, Geodesic& near) {
  if (!around_circle(scaled(a, wrap.radii), scaled(b, wrap.radii), 1).touches) {
    near = {};
    return {};
  }
  if (near.length == 0 || straighten(near, wrap.radii, a, b) > kMostKink) {
    near = shortest_in_planes(a, b, wrap.radii);
    straighten(near, wrap.radii, a, b);
  }
  const Vec3 last = end_of(near, weights_of(wrap)).point;
  return {true, to_world(frame, near.start), to_world(frame, last), near.length};
}

}  // namespace

Wrapped wrap_around(const Wrap& wrap, const Pose& frame, Vec3 p, Vec3 q, Geodesic& near) {
  Vec3 a = to_local(frame, p), b = to_local(frame, q);
  if (wrap.shape == WrapShape::ellipsoid) return around_ellipsoid(wrap, frame, a, b, near);
  const double height = a.z, rise = b.z - a.z, radius = wrap.radii.x;
  const bool cylinder = wrap.shape == WrapShape::cylinder;
  if (cylinder) a.z = b.z = 0;
  const Arc arc = around_circle(a, b, radius);
  if (!arc.touches) return {};
  Vec3 first = at_angle(arc, radius, arc.begin), last = at_angle(arc, radius, arc.end);
  double length = radius * (arc.end - arc.begin);
  if (cylinder) {
    const double whole = arc.before + length + arc.after;
    first.z = height + rise * arc.before / whole;
    last.z = height + rise * (arc.before + length) / whole;
    length *= std::sqrt(1 + rise * rise / (whole * whole));
  }
  return {true, to_world(frame, first), to_world(frame, last), length};
}

// Both shapes wrap as a circle in the plane of the arc: the derivatives within it are those of straight parts
// that turn about fixed points. Across it, a cylinder unrolled has one straight line of the whole length.
// Around a sphere the plane turns about the centre: by the angle g between p and q, for motions u, v across
// it, dg = (u^2/2p^2 + v^2/2q^2) cot g - u v/(p q sin g).
WrapCurvature curvature_around(const Wrap& wrap, const Pose& frame, Vec3 p, Vec3 q) {
  if (wrap.shape == WrapShape::ellipsoid) return {};
  Vec3 a = to_local(frame, p), b = to_local(frame, q);
  const double rise = b.z - a.z, radius = wrap.radii.x;
  const bool cylinder = wrap.shape == WrapShape::cylinder;
  if (cylinder) a.z = b.z = 0;
  const Arc arc = around_circle(a, b, radius);
  if (!arc.touches) return {};
  if (!cylinder) {
    const Vec3 across = frame.rotation * cross(arc.e1, arc.e2);
    const double far = norm(a), other = norm(b), x = dot(b, arc.e1), y = dot(b, arc.e2);
    const double sine = std::max(y / other, 1e-9), bend = radius * (x / other) / sine;
    return {across, across, (arc.before + bend) / (far * far) - 1 / arc.before,
            -radius / (far * other * sine), (arc.after + bend) / (other * other) - 1 / arc.after};
  }
  const double flat = arc.before + radius * (arc.end - arc.begin) + arc.after,
               length = std::hypot(flat, rise);
  const Vec3 first = unit_or(at_angle(arc, radius, arc.begin) - a, {}),
             last = unit_or(b - at_angle(arc, radius, arc.end), {});
  auto across = [&](Vec3 along) {
    return frame.rotation * ((1 / length) * (rise * along - Vec3{0, 0, flat}));
  };
  const double stretched = length / flat;
  return {across(first), across(last), 1 / length - 1 / (stretched * arc.before), -1 / length,
          1 / length - 1 / (stretched * arc.after)};
}

void trace(const std::vector<Wrap>& wraps, Vec3 p, Vec3 q, std::vector<Vec3>& points) {
  for (const Wrap& wrap : wraps) {
    Geodesic near;
    const Wrapped way = wrap_around(wrap, wrap.local, p, q, near);
    if (!way.touches) continue;
    const Vec3 w = weights_of(wrap), start = to_local(wrap.local, way.first);
    const Vec3 n = unit_or({w.x * start.x, w.y * start.y, w.z * start.z}, {0, 0, 1});
    const Vec3 along = direction_across(start - to_local(wrap.local, p), n);
    for (int i = 0; i + 1 < kTraced; ++i)
      points.push_back(to_world(wrap.local, end_of({start, along, way.arc * i / (kTraced - 2)}, w).point));
    return points.push_back(q);
  }
  for (int i = 1; i <= kTraced; ++i) points.push_back(p + (static_cast<double>(i) / kTraced) * (q - p));
}

}  // namespace bt
