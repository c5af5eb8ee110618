#include "geometry/tunnel_bore.h"

#include <algorithm>
#include <cmath>

#include "geometry/segment_distance.h"
#include "math/rounding.h"

namespace bt {

Bore in_world(const Tunnel& tunnel, const Pose& pose) {
  Bore bore;
  bore.start = to_world(pose, tunnel.start);
  const Vec3 way = to_world(pose, tunnel.end) - bore.start;
  bore.length = norm(way);
  bore.axis = (1 / bore.length) * way;
  bore.radius = tunnel.radius;
  bore.chamfer = tunnel.chamfer;
  double steepest = 0;
  for (int mouth : {0, 1}) {
    bore.slope[mouth] = pose.rotation * (mouth ? tunnel.end_slope : tunnel.start_slope);
    steepest = std::max(steepest, norm(bore.slope[mouth]));
  }
  bore.box.include(bore.start);
  bore.box.include(bore.start + way);
  bore.box.grow((1 + steepest) * (bore.radius + bore.chamfer));
  return bore;
}

Rim rim_of(Vec3 centre, Vec3 axis, double radius, Vec3 slope) {
  Rim rim{centre, axis, radius, slope, radius};
  const double steep = norm(slope);
  if (steep == 0) return rim;
  const double stretch = std::sqrt(1 + steep * steep);
  rim.longest = stretch * radius;
  rim.longer = (1 / (steep * stretch)) * slope + (steep / stretch) * axis;
  rim.shorter = (1 / steep) * cross(axis, slope);
  return rim;
}

Rim turned(Rim rim, const Rot3& by) {
  for (Vec3* v : {&rim.axis, &rim.slope, &rim.longer, &rim.shorter}) *v = by * *v;
  return rim;
}

void end_halves(Rim& rim, double distance, Vec3 along) {
  // Seen along the line, the ellipse has the semi-axes A and B. From its point (A c, B s), the normal meets
  // the first of them after B/A sqrt(A^2 s^2 + B^2 c^2).
  const double A = rim.longest * std::fabs(dot(rim.longer, unit_or(cross(along, rim.shorter), {})));
  const double B = rim.radius, seen = distance * A / B;
  const double s2 = A > B ? (seen * seen - B * B) / (A * A - B * B) : 0;
  rim.end_s = std::sqrt(std::min(1.0, std::max(0.0, s2)));
  rim.end_c = std::sqrt(1 - rim.end_s * rim.end_s);
}

Rim Bore::rim(int mouth) const {
  return rim_of(start + chamfer_at(mouth) * axis, axis, radius + chamfer, slope[mouth]);
}

bool Bore::has_wall(Vec3 p, double z) const {
  const Vec3 out = (radius + chamfer) * unit_or(without(p - start, axis), {});
  return z >= chamfer_at(0) + dot(slope[0], out) && z <= chamfer_at(1) + dot(slope[1], out);
}

bool Bore::is_within_rims(Vec3 p) const {
  const double z = along(p), wide = radius + chamfer;
  return z >= chamfer_at(0) + wide * norm(slope[0]) && z <= chamfer_at(1) - wide * norm(slope[1]);
}

bool Bore::is_between(Vec3 a, Vec3 b) const {
  return beyond(0, a) * beyond(0, b) < 0 && beyond(1, a) * beyond(1, b) < 0;
}

bool Bore::is_threaded(Vec3 a, Vec3 b) const {
  const auto in_bore = [&](int mouth) {
    const double from = beyond(mouth, a), to = beyond(mouth, b);
    return off_axis(a + from / (from - to) * (b - a)) <= radius + chamfer;
  };
  return is_between(a, b) && in_bore(0) && in_bore(1);
}

double Bore::leaves(Vec3 a, Vec3 b) const {
  double share = 1;
  for (int mouth : {0, 1}) {
    const double from = beyond(mouth, a), rise = beyond(mouth, b) - from;
    if (rise > 0) share = std::min(share, -from / rise);
  }
  // |p + s d| = R, of the parts across the axis.
  const Vec3 p = without(a - start, axis), d = without(b - a, axis);
  const double dd = dot(d, d), pd = dot(p, d), room = radius * radius - dot(p, p);
  if (dd > 0) share = std::min(share, (std::sqrt(std::max(0.0, pd * pd + dd * room)) - pd) / dd);
  return std::max(0.0, share);
}

namespace {

// Last change of Newton's method that is taken, an angle or a parameter of a segment [-]: the next would be
// its square. Larger: the normals of contacts are less accurate. Smaller: one more iteration, without effect.
constexpr double kArrived = 1e-7;

// A direction in the plane: cosine and sine of an angle.
struct Direction {
  double c, s;
};

Direction direction(double c, double s) {
  const double size = std::sqrt(c * c + s * s);
  return size > 0 ? Direction{c / size, s / size} : Direction{0, 1};
}

// A quarter of an ellipse (A cos, B sin), A > B, from `end` on, which goes on straight before that; and a
// point (x, y) with x >= 0.
//
// With f half the squared distance, f' = (B^2 - A^2) s c + A x s - B y c. Between zeros of s and c, f' / (s
// c) is monotone for y >= 0 and convex for y < 0. If it is negative at the end, it therefore changes sign
// once. If it is positive there and y < 0, it is least where tan^3 = -B y / (A x), and changes sign after
// that if it is negative there: the point is on the other side of the longer axis, and both sides are near.
struct Quarter {
  double A, B, x, y;
  Direction end;
  double excess = A * A - B * B;
  double slope(Direction d) const { return A * x * d.s - B * y * d.c - excess * d.s * d.c; }
  double bend(Direction d) const { return A * x * d.c + B * y * d.s - excess * (d.c * d.c - d.s * d.s); }
  double square(Direction d) const {
    const double along = x - A * d.c, across = y - B * d.s;
    return along * along + across * across;
  }
  // Squared distance from the straight part.
  double straight_square() const {
    const double size2 = A * A * end.s * end.s + B * B * end.c * end.c;
    const double over = B * end.c * (x - A * end.c) + A * end.s * (y - B * end.s);
    return over * over / size2;
  }
  // The nearest point between `low`, where f falls, and the end of the quarter.
  Direction nearest_after(Direction low, Direction at) const;
  // Finds the nearest point, from `at` if that is not zero. Returns false where the straight part is nearest.
  bool nearest(Direction& at) const;
};

Direction Quarter::nearest_after(Direction low, Direction at) const {
  // Iterations of Newton's method [-]. Fewer: points near the middle get a point that is not their nearest.
  constexpr int kIterations = 40;
  Direction high{0, 1};
  if (at.c == 0 && at.s == 0) at = direction(B * x, A * std::fabs(y));
  if (at.s < low.s) at = low;
  for (int i = 0; i < kIterations; ++i) {
    (slope(at) > 0 ? high : low) = at;
    const double curve = bend(at), step = curve > 0 ? -slope(at) / curve : 0;
    Direction next = direction(at.c - step * at.s, at.s + step * at.c);
    if (curve > 0 && std::fabs(step) < kArrived) return next;
    // Beside the root, rounding puts the step outside the bracket: what has arrived is not halved again.
    const bool between = low.c * next.s >= low.s * next.c && next.c * high.s >= next.s * high.c;
    if (curve <= 0 || !between) next = direction(low.c + high.c, low.s + high.s);
    at = next;
  }
  return at;
}

bool Quarter::nearest(Direction& at) const {
  const double first = slope(end);
  if (first < 0 || (first == 0 && bend(end) < 0)) {
    at = nearest_after(end, at);
    return true;
  }
  if (y >= 0) return false;
  const Direction least = direction(std::cbrt(A * x), std::cbrt(-B * y));
  if (least.s <= end.s || slope(least) >= 0) return false;
  at = nearest_after(least, at);
  return square(at) < straight_square();
}

}  // namespace

RimPoint nearest_on_rim(const Rim& rim, Vec3 p, const RimPoint& last) {
  const double A = rim.longest, B = rim.radius;
  if (rim.is_circle()) {
    const Vec3 out = direction_across(p - rim.centre, rim.axis);
    return {rim.centre + B * out, cross(rim.axis, out), (-1 / B) * out};
  }
  const double x = dot(p - rim.centre, rim.longer), y = dot(p - rim.centre, rim.shorter);
  const double side = rim.half ? rim.half : std::copysign(1.0, y);
  Direction at{last.c, last.s};
  const bool arc = Quarter{A, B, std::fabs(x), side * y, {rim.end_c, rim.end_s}}.nearest(at);
  if (!arc) at = {rim.end_c, rim.end_s};
  const double c = std::copysign(at.c, x), s = side * at.s;
  const double square = A * A * s * s + B * B * c * c;
  const Vec3 on_arc = rim.centre + A * c * rim.longer + B * s * rim.shorter;
  const Vec3 tangent = (1 / std::sqrt(square)) * (B * c * rim.shorter - A * s * rim.longer);
  if (!arc) return {on_arc + dot(p - on_arc, tangent) * tangent, tangent};
  return {on_arc, tangent, (-A * B / (square * square)) * (B * c * rim.longer + A * s * rim.shorter), at.c,
          at.s};
}

double slide_to_rim(const BentSegment& segment, double u, const Rim& rim, RimPoint& at) {
  // Iterations of Newton's method [-]. Fewer: where the segment is nearly as far from the rim all along,
  // points are not the nearest, and contacts do not converge.
  constexpr int kIterations = 20;
  if (dot(segment.along, segment.along) == 0) return u;
  double low = -1, high = 2;  // parameters at which the distance falls and rises; the minimum is between them
  for (int i = 0; i < kIterations; ++i) {
    const Vec3 x = segment.at(u), d = segment.tangent(u);
    at = nearest_on_rim(rim, x, at);
    const Vec3 from = x - at.point;
    // Newton's method on half the squared distance: the rim's point moves by t (t.d) / (1 - from.k). Where
    // that is not convex, and where it leaves the bounds, they are halved.
    const double straight = 1 - dot(from, at.curvature), along = dot(at.tangent, d);
    const double slope = dot(from, d), length2 = dot(d, d);
    const double bend = straight > 0 ? length2 - along * along / straight + dot(from, segment.bend_at(u)) : 0;
    if (std::fabs(slope) < kArrived * kArrived * length2) return u;
    (slope > 0 ? high : low) = u;
    double next = bend > 0 ? std::min(std::max(u - slope / bend, 0.0), 1.0) : u;
    if (bend > 0 && std::fabs(next - u) < kArrived) return next;
    if (!(low < next && next < high)) next = 0.5 * (std::max(low, 0.0) + std::min(high, 1.0));
    if (next == u) return u;
    u = next;
  }
  return u;
}

bool passes_beyond(const Rim& rim, Vec3 a, Vec3 b) {
  const double from = rim.height(a), to = rim.height(b);
  if (!(from * to < 0)) return false;
  const Vec3 crossing = a + from / (from - to) * (b - a);
  return norm(without(crossing - rim.centre, rim.axis)) > rim.radius;
}

double nearest_to_rim(const BentSegment& segment, const Rim& rim) {
  // Intervals between samples [-]. Fewer: the nearer one of two minima may be missed. More: slower.
  constexpr int kSamples = 4;
  RimPoint at;
  auto square = [&](double u) {
    const Vec3 p = segment.at(u);
    at = nearest_on_rim(rim, p, at);
    const Vec3 away = p - at.point;
    return dot(away, away);
  };
  int best = 0;
  double least = square(0);
  for (int s = 1; s <= kSamples; ++s) {
    const double value = square(static_cast<double>(s) / kSamples);
    if (value < least) {
      least = value;
      best = s;
    }
  }
  return slide_to_rim(segment, static_cast<double>(best) / kSamples, rim, at);
}

}  // namespace bt
