#include "collision/narrow_phase.h"

#include <algorithm>
#include <cmath>

#include "collision/proximity_cache.h"

namespace bt {

namespace {

// Least cosine between a stretch of tendon's segments and its chord for it to count as straight [-].
constexpr double kStraight = 0.75;

// Stretches of eight segments that are looked at for being straight together at most [-].
constexpr int kFarthestStretch = 64;

// What the ends of two nearly parallel segments may be farther apart by than their nearest points to draw the
// contact towards them, in sums of radii [-]. Larger: the nearer end goes deeper. Smaller: what lies side by
// side is pushed at one end in one step and at the other in the next.
constexpr double kPairEnds = 5e-3;

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

// With every segment of stretch j within the angle t of its heading, and cos(t) >= kStraight = cos(f), all
// are within f of another heading if that is within f - t of the stretch's:
//
//   cos(f - t) = cos f cos t + sin f sin t.
void StraightStretches::find(TendonBvh& tendon) {
  const Tendon& c = tendon.tendon();
  const int m = c.n() - 1, count = (m + kSegments - 1) / kSegments;
  heading_.resize(count);
  agrees_.resize(count);
  to_.resize(count);
  const double sine = std::sqrt(1 - kStraight * kStraight);
  for (int i = 0; i < count; ++i) {
    const int from = i * kSegments, to = std::min(from + kSegments, m);
    heading_[i] = unit_or(c.x.at(to) - c.x.at(from), Vec3{});
    double least = 1;
    for (int k = from; k < to; ++k) {
      const Vec3 d = c.x.at(k + 1) - c.x.at(k);
      const double size = norm(d);
      least = std::min(least, size > 0 ? dot(d, heading_[i]) / size : -1.0);
    }
    agrees_[i] = 2;  // than which no cosine is greater
    if (least >= kStraight)
      agrees_[i] = kStraight * least + sine * std::sqrt(std::max(0.0, 1 - least * least));
  }
  const bool deforms = tendon.most_off_mean() > kFarthestMove * c.radius;  // it may be bent at the step's end
  for (int i = 0; i < count; ++i) {
    const int end = deforms ? i : std::min(count, i + kFarthestStretch);
    int j = i;
    while (j < end && dot(heading_[i], heading_[j]) >= agrees_[j]) ++j;
    to_[i] = j - 1;
  }
}

// How much two segments move relative to each other in the step, as foreseen [m].
double NarrowPhase::motion(int k, int m) const {
  const Tendon &p = a.tendon(), &q = b.tendon();
  double farthest = 0;
  for (int i : {k, k + 1})
    for (int j : {m, m + 1})
      farthest = std::max(farthest, norm(p.predicted.at(i) - p.x.at(i) - q.predicted.at(j) + q.x.at(j)));
  return farthest;
}

// What a straight stretch of one tendon joins turns with it.
Sweep NarrowPhase::sweep(int k, int m) const {
  const Tendon &p = a.tendon(), &q = b.tendon();
  const Field &y = p.predicted, &z = q.predicted;
  Sweep s({p.x.at(k), p.x.at(k + 1), q.x.at(m), q.x.at(m + 1)}, {y.at(k), y.at(k + 1), z.at(m), z.at(m + 1)});
  if (!straight) return s;
  const Vec3 before = s.from[2] - s.from[1], after = z.at(m) - y.at(k + 1);
  const double enough = kStraight * a.arc_between(k, m);
  if (norm(before) > enough && norm(after) > enough) s.unturn(before, after);
  return s;
}

void NarrowPhase::test(int k, int m) {
  const Tendon &p = a.tendon(), &q = b.tendon();
  // Two tendons may move towards each other as wholes.
  const double towards = straight ? 0 : std::min(most, norm(a.mean_motion() - b.mean_motion()));
  if (!overlap(swept_box(p, k, a.mean_motion(), a.skin()), swept_box(q, m, b.mean_motion(), b.skin()),
               towards))
    return;
  if (straight && (straight->join(k, m) || a.joins(k, m) || p.is_overlaid(k, m))) return;
  ++counts.considered;
  const Vec3 p0 = p.x.at(k), p1 = p.x.at(k + 1), q0 = q.x.at(m), q1 = q.x.at(m + 1);
  const double radii = p.radius + q.radius, skins = a.skin() + b.skin(), moves = motion(k, m);
  const double slack = std::max(p.slack[k], p.slack[k + 1]) + std::max(q.slack[m], q.slack[m + 1]);
  const double reach = skins + slack + std::min(moves, most);
  const double centroids = 0.5 * norm(p0 + p1 - q0 - q1);  // step 1
  if (centroids > reach + 0.5 * (norm(p1 - p0) + norm(q1 - q0))) return;
  SegmentPair s{slot_a, k, slot_b, m, 0, 0, {}, 0, false};
  nearest_parameters(p0, p1, q0, q1, s.u, s.w);  // step 2
  between_ends(p0, p1, q0, q1, kPairEnds * radii, s.u, s.w);
  s.apart = (1 - s.u) * p0 + s.u * p1 - ((1 - s.w) * q0 + s.w * q1);
  s.distance = norm(s.apart);
  if (s.distance >= reach) return;
  if (foresight == Foresight::swept && moves > kFarthestMove * radii) {
    const Sweep swept = sweep(k, m);
    if (swept.share_apart(skins + slack) == 1) return;
    const double share = swept.share_apart(skins);
    counts.room = std::min(counts.room, std::max(share, kFarthestMove * radii / moves));
    s.passes = share == 1;
    s.apart = swept.turned(s.apart);
  }
  ++counts.near;
  out.push_back(s);
}

}  // namespace bt
