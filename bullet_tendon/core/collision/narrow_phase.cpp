#include "collision/narrow_phase.h"

#include <algorithm>

#include "collision/proximity_cache.h"

namespace bt {

namespace {

// Least cosine between the segments of a straight stretch and its chord [-].
constexpr double kStraight = 0.75;

// Difference between the distance of nearly parallel segments at their contacts and their least distance
// between the contacts, in sums of radii [-]. Larger: more penetration. Smaller: the contacts of crossing
// segments are nearer to each other, and resist rotation less.
constexpr double kSag = 2e-3;

BT_VECTOR bool runs_straight(const Field& at) {
  const int m = at.size() - 1;
  const double *x = at[0], *y = at[1], *z = at[2];
  const Vec3 chord = at.at(m) - at.at(0);
  const double enough = kStraight * kStraight * dot(chord, chord);
  int bent = dot(chord, chord) > 0 ? 0 : 1;
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    const double dx = x[k + 1] - x[k], dy = y[k + 1] - y[k], dz = z[k + 1] - z[k];
    const double advance = dx * chord.x + dy * chord.y + dz * chord.z;
    bent += advance <= 0 || advance * advance < enough * (dx * dx + dy * dy + dz * dz);
  }
  return bent == 0;
}

}  // namespace

bool is_straight(const Tendon& c) { return runs_straight(c.x) && runs_straight(c.predicted); }

// Predicted relative motion of two segments in the step [m].
double NarrowPhase::motion(int k, int m) const {
  const Tendon &p = a.tendon(), &q = b.tendon();
  double farthest = 0;
  for (int i : {k, k + 1})
    for (int j : {m, m + 1})
      farthest = std::max(farthest, norm(p.predicted.at(i) - p.x.at(i) - q.predicted.at(j) + q.x.at(j)));
  return farthest;
}

// Two segments joined by a straight stretch of one tendon turn with it. This rotation is removed.
Sweep NarrowPhase::sweep(int k, int m) const {
  const Tendon &p = a.tendon(), &q = b.tendon();
  const Field &y = p.predicted, &z = q.predicted;
  Sweep s({p.x.at(k), p.x.at(k + 1), q.x.at(m), q.x.at(m + 1)}, {y.at(k), y.at(k + 1), z.at(m), z.at(m + 1)});
  if (!self) return s;
  const Vec3 before = s.from[2] - s.from[1], after = z.at(m) - y.at(k + 1);
  const double enough = kStraight * a.arc_between(k, m);
  if (norm(before) > enough && norm(after) > enough) s.unturn(before, after);
  return s;
}

PairPoint NarrowPhase::point(int k, int m, PairParameters at) const {
  const Field &x = a.tendon().x, &y = b.tendon().x;
  const Vec3 apart = apart_at(x.at(k), x.at(k + 1), y.at(m), y.at(m + 1), at);
  return {at, apart, norm(apart)};
}

// Sets the contact points of a pair whose nearest points are known. reach [m].
void NarrowPhase::find_points(SegmentPair& s, double reach) const {
  const Tendon &p = a.tendon(), &q = b.tendon();
  const int k = s.segment_a, m = s.segment_b;
  PairParameters ends[2];
  const int count = touching_stretch(p.x.at(k), p.x.at(k + 1), q.x.at(m), q.x.at(m + 1), s.nearest.distance,
                                     kSag * (p.radius + q.radius), ends);
  s.parallel = count > 1;
  if (count == 0) s.points[s.count++] = s.nearest;
  auto is_pair = [&](int i, int j) { return !self || (!a.joins(i, j) && !p.is_overlaid(i, j)); };
  const bool next_a = k + 2 < p.n() && is_pair(k + 1, m), next_b = m + 2 < q.n() && is_pair(k, m + 1);
  for (int end = 0; end < count; ++end) {
    if (count == 1 && ((ends[end].u == 1 && next_a) || (ends[end].w == 1 && next_b))) continue;
    PairPoint at = point(k, m, ends[end]);
    at.end = end;
    if (at.distance < reach) s.points[s.count++] = at;
  }
}

void NarrowPhase::test(int k, int m) {
  const Tendon &p = a.tendon(), &q = b.tendon();
  // Relative mean motion of two tendons within the step [m].
  const double towards = self ? 0 : std::min(most, norm(a.mean_motion() - b.mean_motion()));
  if (!overlap(swept_box(p, k, a.mean_motion(), a.skin()), swept_box(q, m, b.mean_motion(), b.skin()),
               towards))
    return;
  if (self && (a.joins(k, m) || p.is_overlaid(k, m))) return;
  ++counts.considered;
  const Vec3 p0 = p.x.at(k), p1 = p.x.at(k + 1), q0 = q.x.at(m), q1 = q.x.at(m + 1);
  const double radii = p.radius + q.radius, skins = a.skin() + b.skin(), moves = motion(k, m);
  const double slack = std::max(p.slack[k], p.slack[k + 1]) + std::max(q.slack[m], q.slack[m + 1]);
  const double reach = skins + slack + std::min(moves, most);
  const double centroids = 0.5 * norm(p0 + p1 - q0 - q1);  // step 1 of algorithm 1
  if (centroids > reach + 0.5 * (norm(p1 - p0) + norm(q1 - q0))) return;
  SegmentPair s{slot_a, k, slot_b, m};
  s.nearest = point(k, m, nearest_parameters(p0, p1, q0, q1));  // step 2 of algorithm 1
  if (s.nearest.distance >= reach) return;
  find_points(s, reach);
  if (foresight == Foresight::swept && moves > kFarthestMove * radii) {
    const Sweep swept = sweep(k, m);
    if (swept.share_apart(skins + slack) == 1) return;
    s.room = std::max(swept.share_apart(skins), kFarthestMove * radii / moves);
    for (PairPoint& at : s.points) at.apart = swept.turned(at.apart);
  }
  ++counts.near;
  out.push_back(s);
}

}  // namespace bt
