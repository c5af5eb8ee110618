#include "geometry/segment_distance.h"

#include <algorithm>

namespace bt {

namespace {

// Times that two segments are advanced towards each other at most to see when they could touch [-]. Fewer:
// steps are taken in parts because of what passes by.
constexpr int kAdvances = 8;

// One and the cosine of a turn, up to which it may as well be about any axis [-].
constexpr double kHalfTurn = 1e-9;

double clamp01(double t) { return std::min(std::max(t, 0.0), 1.0); }

}  // namespace

// Minimise |p0 + u d - q0 - w e|^2 over the unit square: the free minimiser of u first, then w by
// projection, then u again where w was clamped.
void nearest_parameters(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, double& u, double& w) {
  Vec3 d = p1 - p0, e = q1 - q0, r = p0 - q0;
  double dd = dot(d, d), ee = dot(e, e), de = dot(d, e), dr = dot(d, r), er = dot(e, r);
  double det = dd * ee - de * de;
  // Parallel segments have a whole interval of nearest points: take its middle.
  if (det <= 1e-10 * dd * ee) {
    double w0 = ee > 0 ? clamp01(er / ee) : 0, w1 = ee > 0 ? clamp01((er + de) / ee) : 0;
    w = 0.5 * (w0 + w1);
  } else {
    u = clamp01((de * er - ee * dr) / det);
    w = clamp01((de * u + er) / ee);
  }
  u = dd > 0 ? clamp01((de * w - dr) / dd) : 0;
  w = ee > 0 ? clamp01((de * u + er) / ee) : 0;
}

double segment_distance(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1) {
  double u, w;
  nearest_parameters(p0, p1, q0, q1, u, w);
  return norm((1 - u) * p0 + u * p1 - ((1 - w) * q0 + w * q1));
}

void between_ends(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, double enough, double& u, double& w) {
  const Vec3 d = p1 - p0, e = q1 - q0;
  const double dd = dot(d, d), ee = dot(e, e), de = dot(d, e);
  if (dd == 0 || ee == 0 || dd * ee - de * de > kCrossing * dd * ee) return;
  auto on_b = [&](double at) { return clamp01(dot(p0 + at * d - q0, e) / ee); };
  auto distance = [&](double at, double other) { return norm(p0 + at * d - q0 - other * e); };
  const double least = distance(u, w);
  double end[2], near[2];
  for (int k : {0, 1}) {
    end[k] = clamp01(dot((k ? q1 : q0) - p0, d) / dd);
    near[k] = 1 - (distance(end[k], on_b(end[k])) - least) / enough;
  }
  const double share = std::min(1.0, std::min(near[0], near[1]));
  if (share <= 0) return;
  u = (1 - share) * u + share * (near[0] * end[0] + near[1] * end[1]) / (near[0] + near[1]);
  w = on_b(u);
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
  if (!(dot(p, q) > kHalfTurn - 1)) return;  // about no axis in particular
  before = p;
  after = q;
  const Vec3 pivot = from[1], now = from[1] + way[1];
  for (int i = 0; i < 4; ++i) way[i] = turn(from[i] + way[i] - now, after, before) - (from[i] - pivot);
}

Vec3 Sweep::turned(Vec3 v) const { return turn(v, before, after); }

Vec3 Sweep::apart_at(double share) const {
  Vec3 x[4];
  for (int i = 0; i < 4; ++i) x[i] = from[i] + share * way[i];
  double u, w;
  nearest_parameters(x[0], x[1], x[2], x[3], u, w);
  return (1 - u) * x[0] + u * x[1] - ((1 - w) * x[2] + w * x[3]);
}

double Sweep::share_apart(double enough) const {
  double gone = 0;
  for (int look = 0; look < kAdvances; ++look) {
    const Vec3 apart = apart_at(gone);
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
