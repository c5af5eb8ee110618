#include "ligament/geodesic.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bt {

namespace {

constexpr double kTurnOfStep = 0.1;  // of the direction in a step of integration, at most [rad]
constexpr int kMostSteps = 100;
constexpr int kMostIterations = 40;
constexpr double kStraight = 1e-13;  // sine of a kink that is none
constexpr double kMostMoved = 0.3;   // in an iteration: turns, and shifts over the radius of curvature

Vec3 times(Vec3 a, Vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }

// x, t, and J and J' of both kinds of neighbours; or their derivatives.
struct State {
  Vec3 x, t;
  double beside, beside_slope, turned, turned_slope;
};

void add(State& s, double h, const State& d) {
  s.x += h * d.x;
  s.t += h * d.t;
  s.beside += h * d.beside;
  s.beside_slope += h * d.beside_slope;
  s.turned += h * d.turned;
  s.turned_slope += h * d.turned_slope;
}

State derivative(const State& s, Vec3 w) {
  const Vec3 wx = times(w, s.x);
  const double square = dot(wx, wx), curvature = w.x * w.y * w.z / (square * square);
  return {s.t,
          (-dot(times(w, s.t), s.t) / square) * wx,
          s.beside_slope,
          -curvature * s.beside,
          s.turned_slope,
          -curvature * s.turned};
}

// Butcher 1964, order 6.
void step(State& s, Vec3 w, double h) {
  static constexpr double kStages[7][6] = {
      {},
      {1.0 / 3},
      {0, 2.0 / 3},
      {1.0 / 12, 1.0 / 3, -1.0 / 12},
      {25.0 / 48, -55.0 / 24, 35.0 / 48, 15.0 / 8},
      {3.0 / 20, -11.0 / 24, -1.0 / 8, 1.0 / 2, 1.0 / 10},
      {-261.0 / 260, 33.0 / 13, 43.0 / 156, -118.0 / 39, 32.0 / 195, 80.0 / 39}};
  static constexpr double kSum[7] = {13.0 / 200, 0, 11.0 / 40, 11.0 / 40, 4.0 / 25, 4.0 / 25, 13.0 / 200};
  State slopes[7];
  for (int i = 0; i < 7; ++i) {
    State at = s;
    for (int j = 0; j < i; ++j)
      if (kStages[i][j] != 0) add(at, h * kStages[i][j], slopes[j]);
    slopes[i] = derivative(at, w);
  }
  for (int i = 0; i < 7; ++i)
    if (kSum[i] != 0) add(s, h * kSum[i], slopes[i]);
}

// The frame of a geodesic at one of its ends, the straight part there, and the sines of the kink.
struct Joint {
  Vec3 t, b, n;  // direction, aside, outwards
  Vec3 e;        // of the straight part, along the path
  double inverse;
  Vec3 w, wx;

  Joint(Vec3 x, Vec3 direction, Vec3 weights, Vec3 straight) : w(weights), wx(times(weights, x)) {
    n = unit_or(wx, Vec3{0, 0, 1});
    t = direction_across(direction, n);
    b = cross(n, t);
    inverse = 1 / std::max(norm(straight), 1e-300);
    e = inverse * straight;
  }
  std::array<double, 2> kink() const { return {dot(e, n), dot(e, b)}; }
  // Changes of the kink where the end moves by `by` in the surface and turns by an angle. side: 1 where the
  // straight part comes before it, -1 where it comes after.
  std::array<double, 2> change(Vec3 by, double angle, double side) const {
    const Vec3 de = (side * inverse) * without(by, e), dn = (1 / norm(wx)) * without(times(w, by), n);
    const Vec3 db = -angle * t - dot(b, dn) * n;
    return {dot(de, n) + dot(e, dn), dot(de, b) + dot(e, db)};
  }
};

// Gauss elimination with pivots; false: singular.
bool solve_four(double a[4][5]) {
  for (int c = 0; c < 4; ++c) {
    int best = c;
    for (int r = c + 1; r < 4; ++r)
      if (std::fabs(a[r][c]) > std::fabs(a[best][c])) best = r;
    if (!(std::fabs(a[best][c]) > 1e-300)) return false;
    std::swap(a[c], a[best]);
    for (int r = 0; r < 4; ++r) {
      if (r == c) continue;
      const double share = a[r][c] / a[c][c];
      for (int k = c; k < 5; ++k) a[r][k] -= share * a[c][k];
    }
  }
  for (int c = 0; c < 4; ++c) a[c][4] /= a[c][c];
  return true;
}

// Both ends of the geodesic of a way from p to q.
struct Way {
  GeodesicEnd end;
  Joint first, last;

  Way(const Geodesic& g, Vec3 w, Vec3 p, Vec3 q)
      : end(end_of(g, w)),
        first(g.start, g.direction, w, g.start - p),
        last(end.point, end.direction, w, q - end.point) {}
  double kink() const {
    const auto one = first.kink(), other = last.kink();
    double most = 0;
    for (double s : {one[0], one[1], other[0], other[1]}) most = std::max(most, std::fabs(s));
    const bool back = dot(first.e, first.t) < 0 || dot(last.e, last.t) < 0;
    return back ? 1 + most : most;
  }
};

// What Newton's method changes: the start along and aside [m], its direction [rad], the length [m].
struct Change {
  double along, aside, angle, longer;
};

bool newton_step(const Way& way, Change& change) {
  double a[4][5];
  const GeodesicEnd& end = way.end;
  const Joint &p = way.first, &q = way.last;
  const std::array<double, 2> columns[4][2] = {
      {p.change(p.t, 0, 1), q.change(q.t, 0, -1)},
      {p.change(p.b, 0, 1), q.change(end.beside * q.b, end.beside_slope, -1)},
      {p.change({}, 1, 1), q.change(end.turned * q.b, end.turned_slope, -1)},
      {{0, 0}, q.change(q.t, 0, -1)}};
  const auto at_p = p.kink(), at_q = q.kink();
  for (int r = 0; r < 2; ++r) {
    for (int c = 0; c < 4; ++c) {
      a[r][c] = columns[c][0][r];
      a[2 + r][c] = columns[c][1][r];
    }
    a[r][4] = -at_p[r];
    a[2 + r][4] = -at_q[r];
  }
  if (!solve_four(a)) return false;
  change = {a[0][4], a[1][4], a[2][4], a[3][4]};
  return true;
}

Geodesic moved(const Geodesic& g, const Joint& at, const Change& by, double share, Vec3 w) {
  Geodesic out;
  const Vec3 x = g.start + share * (by.along * at.t + by.aside * at.b);
  out.start = (1 / std::sqrt(dot(times(w, x), x))) * x;
  const double angle = share * by.angle;
  const Vec3 n = unit_or(times(w, out.start), at.n);
  out.direction = unit_or(without(std::cos(angle) * at.t + std::sin(angle) * at.b, n), at.t);
  out.length = std::max(0.0, g.length + share * by.longer);
  return out;
}

}  // namespace

GeodesicEnd end_of(const Geodesic& g, Vec3 w) {
  State s{g.start, g.direction, 1, 0, 0, 1};
  double left = g.length;
  for (int i = 0; i < kMostSteps && left > 0; ++i) {
    const double curvature = std::max({w.x, w.y, w.z}) / norm(times(w, s.x));  // at most
    const double h = i + 1 == kMostSteps ? left : std::min(left, kTurnOfStep / curvature);
    step(s, w, h);
    left -= h;
  }
  return {s.x, s.t, s.beside, s.beside_slope, s.turned, s.turned_slope};
}

double straighten(Geodesic& g, Vec3 radii, Vec3 p, Vec3 q) {
  const Vec3 w{1 / (radii.x * radii.x), 1 / (radii.y * radii.y), 1 / (radii.z * radii.z)};
  const double smallest = std::min({radii.x, radii.y, radii.z});
  Way way(g, w, p, q);
  double kink = way.kink();
  for (int i = 0; i < kMostIterations && kink > kStraight; ++i) {
    Change change;
    if (!newton_step(way, change)) break;
    const double shift =
        std::max({std::fabs(change.along), std::fabs(change.aside), std::fabs(change.longer)});
    double share = std::min(1.0, kMostMoved / std::max(std::fabs(change.angle), shift / smallest));
    bool better = false;
    for (int k = 0; k < 8 && !better; ++k, share *= 0.5) {
      const Geodesic next = moved(g, way.first, change, share, w);
      const Way there(next, w, p, q);
      if (!(there.kink() < kink)) continue;
      better = true;
      g = next;
      way = there;
      kink = there.kink();
    }
    if (!better) break;
  }
  return kink;
}

}  // namespace bt
