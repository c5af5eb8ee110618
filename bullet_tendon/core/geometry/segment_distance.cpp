#include "geometry/segment_distance.h"

#include <algorithm>
#include <cmath>

#include "math/rounding.h"

namespace bt {

namespace {

// Square of the sine between segments under which they are nearly parallel [-].
constexpr double kNearlyParallel = 0.12;

double clamp01(double t) { return std::min(std::max(t, 0.0), 1.0); }

}  // namespace

// Minimise |p0 + u d - q0 - w e|^2 over the unit square: the free minimiser of u first, then w by
// projection, then u again where w was clamped.
PairParameters nearest_parameters(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1) {
  Vec3 d = p1 - p0, e = q1 - q0, r = p0 - q0;
  double dd = dot(d, d), ee = dot(e, e), de = dot(d, e), dr = dot(d, r), er = dot(e, r);
  double det = dd * ee - de * de;
  double w;
  // Parallel segments have a whole interval of nearest points: take its middle.
  if (det <= kRoundingShare * dd * ee) {
    double w0 = ee > 0 ? clamp01(er / ee) : 0, w1 = ee > 0 ? clamp01((er + de) / ee) : 0;
    w = 0.5 * (w0 + w1);
  } else {
    w = clamp01((de * clamp01((de * er - ee * dr) / det) + er) / ee);
  }
  const double u = dd > 0 ? clamp01((de * w - dr) / dd) : 0;
  return {u, ee > 0 ? clamp01((de * u + er) / ee) : 0};
}

double segment_distance(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1) {
  return norm(apart_at(p0, p1, q0, q1, nearest_parameters(p0, p1, q0, q1)));
}

namespace {

// Parameter of the point of start + u way that is nearest to x; any, if the segment has no length.
double projected(Vec3 x, Vec3 start, Vec3 way) {
  const double length2 = dot(way, way);
  return length2 > 0 ? clamp01(dot(x - start, way) / length2) : 0;
}

}  // namespace

// With the lines of both segments at the distance h, the distance of a point of p from the line of q is
// sqrt(h^2 + t^2), t its distance from the crossing of the lines times the sine of their angle. So it is at
// most h + sag where |t| <= sqrt(2 h sag + sag^2). A segment that is not longer than that, with h the
// distance of the segments, is within that distance as a whole, whatever its direction.
int touching_stretch(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, double distance, double sag,
                     PairParameters (&ends)[2]) {
  const Vec3 d = p1 - p0, e = q1 - q0, r = p0 - q0;
  const double dd = dot(d, d), ee = dot(e, e), de = dot(d, e), det = dd * ee - de * de;
  if (std::min(dd, ee) <= (2 * distance + sag) * sag) {
    for (int i : {0, 1}) {
      const double end = i;
      ends[i] = dd <= ee ? PairParameters{end, projected(p0 + end * d, q0, e)}
                         : PairParameters{projected(q0 + end * e, p0, d), end};
    }
    return 2;
  }
  if (det > kNearlyParallel * dd * ee) return 0;
  const double first = projected(q0, p0, d), second = projected(q1, p0, d);
  double from = std::min(first, second), to = std::max(first, second);
  if (det > kRoundingShare * dd * ee) {
    const double dr = dot(d, r), er = dot(e, r), crossing = (de * er - ee * dr) / det;
    const Vec3 apart = r + crossing * d - ((de * crossing + er) / ee) * e;
    const double side = std::sqrt(det / ee);  // |p1 - p0| times the sine
    const double before = (crossing - from) * side, after = (to - crossing) * side;
    if (before > 0 && after > 0) {
      const double most = std::sqrt((2 * norm(apart) + sag) * sag);
      // One end is within `most`. The other one need not be, if that one is so anyway.
      auto limited = [most](double own, double other) {
        return own <= most ? own : most + (own - most) * clamp01(2 - other / most);
      };
      from = std::max(from, crossing - limited(before, after) / side);
      to = std::min(to, crossing + limited(after, before) / side);
    }
  }
  auto on_q = [&](double u) { return projected(p0 + u * d, q0, e); };
  ends[0] = {from, on_q(from)};
  ends[1] = {to, on_q(to)};
  return to > from ? 2 : 1;
}

namespace {

// By the least angle that takes one unit vector to another (Rodrigues).
Vec3 turn(Vec3 v, Vec3 from, Vec3 to) {
  const Vec3 axis = cross(from, to), side = cross(axis, v);
  return v + side + (1 / (1 + dot(from, to))) * cross(axis, side);
}

}  // namespace

Sweep::Sweep(const Vec3 (&start)[4], const Vec3 (&end)[4]) {
  for (int i = 0; i < 4; ++i) {
    from[i] = start[i];
    way[i] = end[i] - start[i];
  }
}

void Sweep::unturn(Vec3 chord, Vec3 chord_after) {
  const Vec3 p = unit_or(chord, {}), q = unit_or(chord_after, {});
  if (!(dot(p, q) > kRoundingShare - 1)) return;  // about no axis in particular
  before = p;
  after = q;
  const Vec3 pivot = from[1], now = from[1] + way[1];
  for (int i = 0; i < 4; ++i) way[i] = turn(from[i] + way[i] - now, after, before) - (from[i] - pivot);
}

Vec3 Sweep::turned(Vec3 v) const { return turn(v, before, after); }

Vec3 Sweep::nearest_apart(double share) const {
  Vec3 x[4];
  for (int i = 0; i < 4; ++i) x[i] = from[i] + share * way[i];
  return apart_at(x[0], x[1], x[2], x[3], nearest_parameters(x[0], x[1], x[2], x[3]));
}

double Sweep::share_apart(double enough) const {
  double gone = 0;
  for (int look = 0; look < kAdvances; ++look) {
    const Vec3 apart = nearest_apart(gone);
    const double distance = norm(apart);
    if (distance <= enough) return gone;
    double nears = 0;
    for (int i : {0, 1})
      for (int j : {2, 3}) nears = std::max(nears, dot(apart, way[j] - way[i]) / distance);
    if (distance - (1 - gone) * nears > enough) return 1;
    gone += (distance - enough) / nears;
  }
  return gone;
}

}  // namespace bt
