#include "pairs.h"

#include "constants.h"

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

void BoxTree::refit(const Chain& c, double dt, double threshold) {
  const int m = c.n() - 1;
  segments.resize(m);
  leaves.assign((m + kLeaf - 1) / kLeaf, Box{});
  all = Box{};
  mean_velocity = {};
  for (int i = 0; i < c.n(); ++i) mean_velocity += (1.0 / c.n()) * c.v.at(i);
  skin = c.radius * kSkin + 0.5 * threshold;
  for (int k = 0; k < m; ++k) {
    double speed = std::max(norm(c.v.at(k) - mean_velocity), norm(c.v.at(k + 1) - mean_velocity));
    Box b;
    b.include(c.x.at(k)), b.include(c.x.at(k + 1));
    b.grow(skin + std::min(kForesight * dt * speed, kFarthest * c.radius));
    segments[k] = b;
    leaves[k / kLeaf].include(b);
  }
  for (const Box& b : leaves) all.include(b);
  find_straight(c);
}

void BoxTree::find_straight(const Chain& c) {
  const int m = c.n() - 1, count = static_cast<int>(leaves.size());
  straight.assign(count, 1);
  for (int i = 0; i < count; ++i) {
    const int from = i * kLeaf, to = std::min((i + 2) * kLeaf, m);
    const Vec3 along = unit_or(c.x.at(to) - c.x.at(from), Vec3{});
    for (int k = from; k < to && straight[i]; ++k) {
      const Vec3 d = c.x.at(k + 1) - c.x.at(k);
      const double advance = dot(d, along);
      straight[i] = advance > 0 && advance * advance >= kStraight * kStraight * dot(d, d);
    }
  }
}

namespace {

struct Finder {
  const Chain *a, *b;
  const BoxTree *ta, *tb;
  int ia, ib;
  std::vector<SegmentPair>& out;
  PairCounts& counts;
  double dt = 0, margin = 0;

  // Segments that a spring joins, or so near along the tendon that no bend brings them together.
  bool joined(int k, int m) const {
    if (a != b) return false;
    if (m - k <= 1) return true;
    double arc = 0, enough = kSelfContactArc * a->radius;
    for (int j = k + 1; j < m; ++j)
      if ((arc += a->rest[j]) >= enough) return false;
    return true;
  }

  // How much the distance of two segments can shrink in the step [m].
  double approach(int k, int m) const {
    double fastest = 0;
    for (int i : {k, k + 1})
      for (int j : {m, m + 1}) fastest = std::max(fastest, norm(a->v.at(i) - b->v.at(j)));
    return std::min(kForesight * dt * fastest, kFarthest * (a->radius + b->radius));
  }

  void measure(int k, int m) {
    if (!overlap(ta->segments[k], tb->segments[m], margin) || joined(k, m)) return;
    ++counts.considered;
    Vec3 p0 = a->x.at(k), p1 = a->x.at(k + 1), q0 = b->x.at(m), q1 = b->x.at(m + 1);
    double reach = ta->skin + tb->skin + approach(k, m);
    double centroids = 0.5 * norm(p0 + p1 - q0 - q1);  // step 1
    if (centroids > reach + 0.5 * (norm(p1 - p0) + norm(q1 - q0))) return;
    SegmentPair s{ia, k, ib, m, 0, 0, {}, 0};
    nearest_parameters(p0, p1, q0, q1, s.u, s.w);  // step 2
    s.apart = (1 - s.u) * p0 + s.u * p1 - ((1 - s.w) * q0 + s.w * q1);
    s.distance = norm(s.apart);
    if (s.distance < reach) ++counts.near, out.push_back(s);
  }

  void run() {
    // Two tendons may move towards each other as wholes.
    margin = a == b ? 0
                    : std::min(kForesight * dt * norm(ta->mean_velocity - tb->mean_velocity),
                               kFarthest * (a->radius + b->radius));
    if (!overlap(ta->all, tb->all, margin)) return;
    const int L = BoxTree::kLeaf;
    const int la = static_cast<int>(ta->leaves.size()), lb = static_cast<int>(tb->leaves.size());
    for (int i = 0; i < la; ++i)
      for (int j = a == b ? i : 0; j < lb; ++j) {
        if (a == b && j <= i + 1 && ta->straight[i]) continue;
        if (!overlap(ta->leaves[i], tb->leaves[j], margin)) continue;
        for (int k = i * L; k < std::min((i + 1) * L, a->n() - 1); ++k)
          for (int m = a == b ? std::max(j * L, k + 1) : j * L; m < std::min((j + 1) * L, b->n() - 1); ++m)
            measure(k, m);
      }
  }
};

}  // namespace

PairCounts find_pairs(const std::vector<Chain*>& chains, const std::vector<BoxTree>& trees, double dt,
                      std::vector<SegmentPair>& out) {
  PairCounts counts;
  const int count = static_cast<int>(chains.size());
  for (int i = 0; i < count; ++i)
    for (int j = i; j < count; ++j)
      if (chains[i] && chains[j])
        Finder{chains[i], chains[j], &trees[i], &trees[j], i, j, out, counts, dt}.run();
  return counts;
}

}  // namespace bt
