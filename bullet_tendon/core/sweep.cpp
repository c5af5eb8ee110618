// Conservative advancement (Mirtich 1996): what is nearest lies between two planes, which near each other no
// faster than the segments' ends do along their normal.
#include "sweep.h"

#include <algorithm>

#include "constants.h"
#include "pairs.h"

namespace bt {

namespace {

// By the least angle that takes one unit vector to another (Rodrigues).
Vec3 turn(Vec3 v, Vec3 from, Vec3 to) {
  const Vec3 axis = cross(from, to), side = cross(axis, v);
  return v + side + (1 / (1 + dot(from, to))) * cross(axis, side);
}

}  // namespace

Sweep::Sweep(const Vec3 (&start)[4], const Vec3 (&end)[4]) {
  for (int i = 0; i < 4; ++i) from[i] = start[i], way[i] = end[i] - start[i];
}

void Sweep::unturn(Vec3 chord, Vec3 chord_after) {
  const Vec3 p = unit_or(chord, {}), q = unit_or(chord_after, {});
  if (!(dot(p, q) > kHalfTurn - 1)) return;  // about no axis in particular
  before = p, after = q;
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
