#include "pairs.h"

#include <cmath>

#include "constants.h"
#include "near.h"
#include "sweep.h"

namespace bt {

namespace {
double clamp01(double t) { return t < 0 ? 0 : t > 1 ? 1 : t; }
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

// Of nearly parallel segments, what is nearest jumps from one end of their overlap to the other as they turn
// by nothing, and they with it. Ends that are nearly as near as the nearest points draw these towards them,
// so that they move as the segments turn.
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

BT_VECTOR bool is_straight(const Chain& c, const Field& at) {
  const int m = c.n() - 1;
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

BT_VECTOR bool strays(const Chain& c) {
  int count = 0;
  const double *x = c.next[0], *y = c.next[1], *z = c.next[2], *slack = c.slack.data();
  const double *fx = c.foreseen[0], *fy = c.foreseen[1], *fz = c.foreseen[2];
#pragma GCC ivdep
  for (int i = 0; i < c.n(); ++i) {
    const double dx = x[i] - fx[i], dy = y[i] - fy[i], dz = z[i] - fz[i];
    count += dx * dx + dy * dy + dz * dz > slack[i] * slack[i];
  }
  return count > 0;
}

BT_VECTOR Box box_of_reach(const Chain& c, double threshold) {
  Box box;
  double slack = 0, square = 0;
  for (int i = 0; i < c.n(); ++i) {
    const Vec3 x = c.x.at(i), moved = c.foreseen.at(i) - x;
    box.include(x);
    square = std::max(square, dot(moved, moved)), slack = std::max(slack, c.slack[i]);
  }
  box.grow(c.radius + 0.5 * threshold + slack + std::sqrt(square));
  return box;
}

void BoxTree::refit(const Chain& c, double threshold) {
  const int m = c.n() - 1;
  segments.resize(m);
  leaves.assign((m + kLeaf - 1) / kLeaf, Box{});
  all = Box{};
  mean_motion = {};
  for (int i = 0; i < c.n(); ++i) mean_motion += (1.0 / c.n()) * (c.foreseen.at(i) - c.x.at(i));
  skin = c.radius + 0.5 * threshold;
  farthest_ = 0;
  for (int k = 0; k < m; ++k) {
    Box b;
    for (int i : {k, k + 1}) {
      b.include(c.x.at(i)), b.include(c.foreseen.at(i) - mean_motion);
      farthest_ = std::max(farthest_, norm(c.foreseen.at(i) - mean_motion - c.x.at(i)));
    }
    b.grow(skin + std::max(c.slack[k], c.slack[k + 1]));
    segments[k] = b;
    leaves[k / kLeaf].include(b);
  }
  branches.assign((leaves.size() + kLeaf - 1) / kLeaf, Box{});
  for (size_t i = 0; i < leaves.size(); ++i) branches[i / kLeaf].include(leaves[i]);
  for (const Box& b : branches) all.include(b);
  arc.resize(c.n());
  arc[0] = 0;
  for (int k = 0; k < m; ++k) arc[k + 1] = arc[k] + c.rest[k];
  find_straight(c);
}

// With every segment of leaf j within the angle t of its heading, and cos(t) >= kStraight = cos(f), all are
// within f of another heading if that is within f - t of the leaf's: cos(f - t) = cos f cos t + sin f sin t.
void BoxTree::find_straight(const Chain& c) {
  const int m = c.n() - 1, count = static_cast<int>(leaves.size());
  heading_.resize(count), agrees_.resize(count), straight_to.resize(count);
  const double across = std::sqrt(1 - kStraight * kStraight);
  for (int i = 0; i < count; ++i) {
    const int from = i * kLeaf, to = std::min(from + kLeaf, m);
    heading_[i] = unit_or(c.x.at(to) - c.x.at(from), Vec3{});
    double least = 1;
    for (int k = from; k < to; ++k) {
      const Vec3 d = c.x.at(k + 1) - c.x.at(k);
      const double size = norm(d);
      least = std::min(least, size > 0 ? dot(d, heading_[i]) / size : -1.0);
    }
    agrees_[i] =
        least >= kStraight ? kStraight * least + across * std::sqrt(std::max(0.0, 1 - least * least)) : 2;
  }
  for (int i = 0; i < count; ++i) {
    int j = i - 1;
    straight_to[i] = j;
    if (farthest_ > kFarthestMove * c.radius) continue;  // may not be straight at the end of the step
    while (j + 1 < std::min(count, i + kFarthestLeaf) && dot(heading_[i], heading_[j + 1]) >= agrees_[j + 1])
      ++j;
    straight_to[i] = j;
  }
}

namespace {

struct Finder {
  const Chain *a, *b;
  const BoxTree *ta, *tb;
  int ia, ib;
  std::vector<SegmentPair>& out;
  PairCounts& counts;
  Foresight foresight;
  bool far = foresight != Foresight::near;
  double margin = 0;

  // Segments that a spring joins, or so near along the tendon that no bend brings them together.
  bool joined(int k, int m) const {
    if (a != b) return false;
    if (m - k <= 1) return true;
    return ta->arc[m] - ta->arc[k + 1] < kSelfContactArc * a->radius;
  }

  // How much two segments move relative to each other in the step, as foreseen [m].
  double motion(int k, int m) const {
    double farthest = 0;
    for (int i : {k, k + 1})
      for (int j : {m, m + 1})
        farthest = std::max(farthest, norm(a->foreseen.at(i) - a->x.at(i) - b->foreseen.at(j) + b->x.at(j)));
    return farthest;
  }

  // What a straight stretch of tendon joins turns with it.
  Sweep sweep(int k, int m) const {
    const Field &y = a->foreseen, &z = b->foreseen;
    Sweep s({a->x.at(k), a->x.at(k + 1), b->x.at(m), b->x.at(m + 1)},
            {y.at(k), y.at(k + 1), z.at(m), z.at(m + 1)});
    if (a != b) return s;
    const Vec3 before = s.from[2] - s.from[1], after = z.at(m) - y.at(k + 1);
    const double enough = kStraight * (ta->arc[m] - ta->arc[k + 1]);
    if (norm(before) > enough && norm(after) > enough) s.unturn(before, after);
    return s;
  }

  void measure(int k, int m) {
    if (!overlap(ta->segments[k], tb->segments[m], margin) || joined(k, m)) return;
    if (a == b && a->is_overlaid(k, m)) return;
    ++counts.considered;
    Vec3 p0 = a->x.at(k), p1 = a->x.at(k + 1), q0 = b->x.at(m), q1 = b->x.at(m + 1);
    const double radii = a->radius + b->radius, moves = motion(k, m);
    const double slack = std::max(a->slack[k], a->slack[k + 1]) + std::max(b->slack[m], b->slack[m + 1]);
    const double skins = ta->skin + tb->skin;
    double reach = skins + slack + (far ? moves : std::min(moves, kFarthest * radii));
    double centroids = 0.5 * norm(p0 + p1 - q0 - q1);  // step 1
    if (centroids > reach + 0.5 * (norm(p1 - p0) + norm(q1 - q0))) return;
    SegmentPair s{ia, k, ib, m, 0, 0, {}, 0, false};
    nearest_parameters(p0, p1, q0, q1, s.u, s.w);  // step 2
    between_ends(p0, p1, q0, q1, kPairEnds * radii, s.u, s.w);
    s.apart = (1 - s.u) * p0 + s.u * p1 - ((1 - s.w) * q0 + s.w * q1);
    s.distance = norm(s.apart);
    if (s.distance >= reach) return;
    if (foresight == Foresight::far)
      counts.room = std::min(counts.room, share_to_go(s.distance, radii, moves));
    if (foresight == Foresight::swept && moves > kFarthestMove * radii) {
      const Sweep swept = sweep(k, m);
      if (swept.share_apart(skins + slack) == 1) return;
      const double share = swept.share_apart(skins);
      counts.room = std::min(counts.room, std::max(share, kFarthestMove * radii / moves));
      s.passes = share == 1;
      s.apart = swept.turned(s.apart);
    }
    ++counts.near, out.push_back(s);
  }

  void run() {
    // Two tendons may move towards each other as wholes.
    margin = a == b ? 0 : norm(ta->mean_motion - tb->mean_motion);
    if (!far) margin = std::min(margin, kFarthest * (a->radius + b->radius));
    if (!overlap(ta->all, tb->all, margin)) return;
    const int branches_a = static_cast<int>(ta->branches.size()),
              branches_b = static_cast<int>(tb->branches.size());
    for (int i = 0; i < branches_a; ++i)
      for (int j = a == b ? i : 0; j < branches_b; ++j)
        if (overlap(ta->branches[i], tb->branches[j], margin)) in_branches(i, j);
  }

  void in_branches(int branch_a, int branch_b) {
    const int L = BoxTree::kLeaf;
    const int la = static_cast<int>(ta->leaves.size()), lb = static_cast<int>(tb->leaves.size());
    for (int i = branch_a * L; i < std::min((branch_a + 1) * L, la); ++i) {
      // Nothing of a straight stretch touches itself.
      const int first = a == b ? std::max({branch_b * L, i, ta->straight_to[i] + 1}) : branch_b * L;
      for (int j = first; j < std::min((branch_b + 1) * L, lb); ++j)
        if (overlap(ta->leaves[i], tb->leaves[j], margin)) in_leaves(i, j);
    }
  }

  void in_leaves(int i, int j) {
    const int L = BoxTree::kLeaf;
    for (int k = i * L; k < std::min((i + 1) * L, a->n() - 1); ++k)
      for (int m = a == b ? std::max(j * L, k + 1) : j * L; m < std::min((j + 1) * L, b->n() - 1); ++m)
        measure(k, m);
  }
};

}  // namespace

PairCounts find_pairs(const std::vector<Chain*>& chains, const std::vector<BoxTree>& trees,
                      Foresight foresight, std::vector<SegmentPair>& out) {
  PairCounts counts;
  const int count = static_cast<int>(chains.size());
  for (int i = 0; i < count; ++i)
    for (int j = i; j < count; ++j)
      if (chains[i] && chains[j])
        Finder{chains[i], chains[j], &trees[i], &trees[j], i, j, out, counts, foresight}.run();
  return counts;
}

}  // namespace bt
