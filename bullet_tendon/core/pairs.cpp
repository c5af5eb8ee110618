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

// With every segment of leaf j within the angle t of its heading, and cos(t) >= kStraight = cos(f), all are
// within f of another heading if that is within f - t of the leaf's: cos(f - t) = cos f cos t + sin f sin t.
void Straight::find(const Chain& c, double off) {
  const int m = c.n() - 1, count = (m + kLeaf - 1) / kLeaf;
  heading_.resize(count), agrees_.resize(count), to_.resize(count);
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
    to_[i] = j;
    if (off > kFarthestMove * c.radius) continue;  // may not be straight at the end of the step
    while (j + 1 < std::min(count, i + kFarthestLeaf) && dot(heading_[i], heading_[j + 1]) >= agrees_[j + 1])
      ++j;
    to_[i] = j;
  }
}

namespace {

// Of two tendons, or of one.
struct Measuring {
  const Searched &of_a, &of_b;
  const Chain &a = *of_a.chain, &b = *of_b.chain;
  const int slot_a, slot_b;
  const Foresight foresight;
  const Straight* straight;  // of one tendon
  PairCounts& counts;
  std::vector<SegmentPair>& out;
  const bool far = foresight != Foresight::near;
  const double radii = a.radius + b.radius, skins = of_a.travel.skin() + of_b.travel.skin();
  // How much two segments move relative to each other in the step, as foreseen [m].
  double motion(int k, int m) const {
    double farthest = 0;
    for (int i : {k, k + 1})
      for (int j : {m, m + 1})
        farthest = std::max(farthest, norm(a.foreseen.at(i) - a.x.at(i) - b.foreseen.at(j) + b.x.at(j)));
    return farthest;
  }

  // What a straight stretch of tendon joins turns with it.
  Sweep sweep(int k, int m) const {
    const Field &y = a.foreseen, &z = b.foreseen;
    Sweep s({a.x.at(k), a.x.at(k + 1), b.x.at(m), b.x.at(m + 1)},
            {y.at(k), y.at(k + 1), z.at(m), z.at(m + 1)});
    if (!straight) return s;
    const Vec3 before = s.from[2] - s.from[1], after = z.at(m) - y.at(k + 1);
    const double enough = kStraight * of_a.arc_between(k, m);
    if (norm(before) > enough && norm(after) > enough) s.unturn(before, after);
    return s;
  }

  void operator()(int k, int m) {
    if (straight && (straight->joins(k, m) || of_a.joins(k, m) || a.is_overlaid(k, m))) return;
    ++counts.considered;
    Vec3 p0 = a.x.at(k), p1 = a.x.at(k + 1), q0 = b.x.at(m), q1 = b.x.at(m + 1);
    const double moves = motion(k, m);
    const double slack = std::max(a.slack[k], a.slack[k + 1]) + std::max(b.slack[m], b.slack[m + 1]);
    double reach = skins + slack + (far ? moves : std::min(moves, kFarthest * radii));
    double centroids = 0.5 * norm(p0 + p1 - q0 - q1);  // step 1
    if (centroids > reach + 0.5 * (norm(p1 - p0) + norm(q1 - q0))) return;
    SegmentPair s{slot_a, k, slot_b, m, 0, 0, {}, 0, false};
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
};

}  // namespace

void PairFinder::clear() { tendons_.clear(), searches_.clear(), crowd_.forget(); }

PairCounts PairFinder::find(const std::vector<Chain*>& chains, double threshold, Foresight foresight,
                            std::vector<SegmentPair>& out) {
  const int count = static_cast<int>(chains.size());
  if (tendons_.size() != chains.size()) clear();
  tendons_.resize(count), searches_.resize(slot_of(0, count));
  long there = 0;
  for (int c = 0; c < count; ++c) {
    tendons_[c].chain = chains[c];
    if (chains[c]) tendons_[c].look(*chains[c], threshold), ++there;
  }
  ++looks_;
  PairCounts counts;
  counts.skipped = there * (there + 1) / 2;
  if (crowd_.stays_clear(tendons_)) return counts;
  if (all_clear()) return crowd_.share(tendons_, searches_), counts;
  counts.skipped = 0;
  for (int i = 0; i < count; ++i)
    for (int j = i; j < count; ++j)
      if (chains[i] && chains[j]) find_of(i, j, foresight, counts, out);
  return counts;
}

bool PairFinder::all_clear() const {
  for (size_t j = 0; j < tendons_.size(); ++j)
    for (size_t i = 0; i <= j; ++i)
      if (tendons_[i].chain && tendons_[j].chain &&
          !searches_[slot_of(i, j)].stays_clear(tendons_[i], tendons_[j]))
        return false;
  return true;
}

// Of what was found, segments whose boxes meet.
void PairFinder::list_near(Searched& a, Searched& b, Found found, PairSearch& search, double most) {
  near_.clear();
  // Two tendons may move towards each other as wholes.
  auto take = [&, margin = -1.0](int k, int m) mutable {
    if (margin < 0) margin = &a == &b ? 0 : std::min(most, norm(a.mean_motion() - b.mean_motion()));
    if (overlap(a.box(k), b.box(m), margin)) near_.push_back({k, m, 0});
  };
  if (found == Found::listed) return search.each_listed(take);
  leaves_.clear();
  search.front.look(a, b, a.travel.reach() + b.travel.reach(), most, leaves_);
  for (const StrandPair& s : leaves_) {
    const Strand &p = a.strand(s.i), &q = b.strand(s.j);
    for (int k = p.first; k < p.last; ++k)
      for (int m = &p == &q ? k + 1 : q.first; m < q.last; ++m) take(k, m);
  }
  put_in_order(near_);
}

void PairFinder::find_of(int i, int j, Foresight foresight, PairCounts& counts,
                         std::vector<SegmentPair>& out) {
  Searched &a = tendons_[i], &b = tendons_[j];
  PairSearch& search = searches_[slot_of(i, j)];
  if (search.stays_clear(a, b)) return void(++counts.skipped);
  const Travel &p = a.travel.way(), &q = b.travel.way();
  const double most = foresight == Foresight::near ? kFarthest * (a.chain->radius + b.chain->radius) : 1e300;
  const double reach =
      a.travel.reach() + b.travel.reach() + std::min(most, norm(p.by - q.by) + p.off + q.off);
  const long before = counts.searches;
  const Found found = search.look(a, b, reach, looks_, counts.searches);
  counts.skipped += found != Found::watched && counts.searches == before;
  if (found == Found::nothing || (i == j && a.is_straight())) return;
  list_near(a, b, found, search, most);
  if (near_.empty()) return;
  if (i == j) straight_.find(*a.chain, a.farthest());
  Measuring measure{a, b, *a.chain, *b.chain, i, j, foresight, i == j ? &straight_ : nullptr, counts, out};
  for (const NearSegments& s : near_) measure(s.k, s.m);
}

}  // namespace bt
