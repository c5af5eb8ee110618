#include "collision/broad_phase.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "math/rounding.h"
#include "tendon/tendon.h"

namespace bt {

namespace {

// Increase of the contact distance per arc length: of two tendons along both, from anchors whose distance is
// less than the sum of radii, and of a tendon and a link from an attachment whose distance is less than the
// radius [-]. Larger: tendons with one common anchor, and insertions, are bent and stretched. Smaller: they
// overlap along a longer arc.
constexpr double kParting = 0.1;

// Greatest relative motion for which methods without substeps predict tendon pairs, in sums of radii [-].
// Larger: a contact is a plane, and would stop distant segments that would pass beside each other.
constexpr double kFarthest = 2.0;

double sum_of_radii(const TendonBvh& a, const TendonBvh& b) { return a.tendon().radius + b.tendon().radius; }

// Predicted relative motion in the step, limited to `most` [m].
double foreseen(const TendonBvh& a, const TendonBvh& b, double most) {
  return std::min(most, relative_motion(a.ahead(), b.ahead()));
}

}  // namespace

// Descends both hierarchies where segments may be within the limit.
struct Collector {
  const TendonBvh &a, &b;
  const double reach;  // sum of both tendons' [m]
  const double most;   // limit of the relative motion within the step [m]
  const double limit;  // of the distances of candidates [m]
  const bool once;     // the list is for this step only
  CandidateList& list;
  const bool self = &a == &b;
  // Relative mean motion of two tendons within the step [m].
  const double towards = self ? 0 : std::min(most, norm(a.mean_motion() - b.mean_motion()));

  using Node = TendonBvh::Node;

  // Box around the present and the predicted positions, less the tendon's mean motion.
  static Box swept(const Node& s, Vec3 mean) {
    return {lowest(s.at.lo, s.at.lo + s.ahead.lo - mean), highest(s.at.hi, s.at.hi + s.ahead.hi - mean)};
  }

  // Whether segments can touch within this step. Their boxes are disjoint; square: squared distance [m^2].
  bool may_touch_now(const Node& p, const Node& q, double square) const {
    const Vec3 moves = highest(p.ahead.hi - q.ahead.lo, q.ahead.hi - p.ahead.lo);
    const double enough = (1 + kRoundingShare) * (reach + std::min(most, norm(moves)));
    if (square > enough * enough) return false;
    const Vec3 gap = gap_between(swept(p, a.mean_motion()), swept(q, b.mean_motion()));
    return max_abs(gap) <= (1 + kRoundingShare) * (reach + towards);
  }

  void leave_out(double square) { list.left_out_ = std::min(list.left_out_, square); }

  void within(int i) {
    if (a.is_empty(i) || a.joins(a.first(i), a.last(i))) return;
    within(2 * i);
    within(2 * i + 1);
    between(2 * i, 2 * i + 1);
  }

  // If both are nodes of one tendon, i comes before j.
  void between(int i, int j) {
    if (a.is_empty(i) || b.is_empty(j)) return;
    if (self && a.joins(a.first(i), b.last(j))) return;
    const Vec3 gap = gap_between(a[i].at, b[j].at);
    const double square = dot(gap, gap);
    const bool apart =
        !(square <= limit * limit) || (once && square > 0 && !may_touch_now(a[i], b[j], square));
    if (apart) return leave_out(square);
    if (a.is_leaf(i) && b.is_leaf(j)) return measure(a.first(i), b.first(j));
    if (a.width(i) >= b.width(j)) {
      between(2 * i, j);
      between(2 * i + 1, j);
    } else {
      between(i, 2 * j);
      between(i, 2 * j + 1);
    }
  }

  void measure(int k, int m) {
    const Field &x = a.tendon().x, &y = b.tendon().x;
    const double distance = segment_distance(x.at(k), x.at(k + 1), y.at(m), y.at(m + 1));
    if (distance <= limit)
      list.candidates_.push_back({k, m, distance});
    else
      leave_out(distance * distance);
  }
};

double CandidateList::needed(const TendonBvh& a, const TendonBvh& b, double most) const {
  const Vec3 by = (a.moved().by - a_moved_.by) - (b.moved().by - b_moved_.by);
  const double off = (a.moved().off - a_moved_.off) + (b.moved().off - b_moved_.off);
  return (1 + kRoundingShare) * (a.reach() + b.reach() + norm(by) + off + foreseen(a, b, most));
}

bool CandidateList::serves(const TendonBvh& a, const TendonBvh& b, double needed) const {
  return needed < left_out_ && a_rest_ == a.rest_set() && b_rest_ == b.rest_set();
}

void CandidateList::collect(TendonBvh& a, TendonBvh& b, double most) {
  a_moved_ = a.moved();
  b_moved_ = b.moved();
  a_rest_ = a.rest_set();
  b_rest_ = b.rest_set();
  candidates_.clear();
  left_out_ = 1e300;
  a.refit();
  b.refit();
  const double margin = kListMargin * sum_of_radii(a, b), reach = a.reach() + b.reach();
  const double moves = foreseen(a, b, most);
  const bool once = moves > 0.5 * margin;
  const double limit = (1 + kRoundingShare) * (reach + (once ? moves : margin));
  Collector collector{a, b, reach, most, limit, once, *this};
  if (&a == &b)
    collector.within(1);
  else
    collector.between(1, 1);
  left_out_ = std::isfinite(limit) ? std::sqrt(left_out_) : 0;
  std::sort(candidates_.begin(), candidates_.end(),
            [](const Candidate& p, const Candidate& q) { return p.k != q.k ? p.k < q.k : p.m < q.m; });
  nearest_ = 1e300;
  for (const Candidate& s : candidates_) nearest_ = std::min(nearest_, s.distance);
}

void BroadPhase::clear() {
  tendons_.clear();
  lists_.clear();
}

PairCounts BroadPhase::find(const std::vector<Tendon*>& tendons, const CollisionFilter& filter,
                            double threshold, Foresight foresight, std::vector<SegmentPair>& out) {
  if (tendons_.size() != tendons.size()) clear();
  tendons_.resize(tendons.size());
  extents_.clear();
  for (int c = 0; c < static_cast<int>(tendons.size()); ++c) {
    if (!tendons[c] || filter.is_inert(c)) continue;
    tendons_[c].follow(*tendons[c], threshold);
    extents_.push_back({c, box_of(tendons[c]->x)});
    const MotionBound& ahead = tendons_[c].ahead();
    extents_.back().box.grow((1 + kRoundingShare) * (tendons_[c].reach() + norm(ahead.by) + ahead.off));
  }
  find_near(filter);
  take_lists();
  PairCounts counts;
  counts.skipped = static_cast<long>(extents_.size() * (extents_.size() + 1) / 2 - lists_.size());
  for (PairList& pair : lists_) find_between(pair, foresight, counts, out);
  return counts;
}

// Sweep and prune (Baraff 1992) along one axis.
void BroadPhase::find_near(const CollisionFilter& filter) {
  Box middles;
  for (const Extent& e : extents_) middles.include(e.box.middle());
  const Vec3 spread = middles.hi - middles.lo;
  double Vec3::* axis = &Vec3::x;
  for (double Vec3::* other : {&Vec3::y, &Vec3::z})
    if (spread.*other > spread.*axis) axis = other;
  std::sort(extents_.begin(), extents_.end(), [&](const Extent& a, const Extent& b) {
    return a.box.lo.*axis != b.box.lo.*axis ? a.box.lo.*axis < b.box.lo.*axis : a.tendon < b.tendon;
  });
  near_.clear();
  for (size_t a = 0; a < extents_.size(); ++a)
    for (size_t b = a; b < extents_.size() && extents_[b].box.lo.*axis <= extents_[a].box.hi.*axis; ++b) {
      const auto [i, j] = std::minmax(extents_[a].tendon, extents_[b].tendon);
      if (overlap(extents_[a].box, extents_[b].box) && filter.meet(i, j)) near_.push_back({i, j, {}});
    }
  std::sort(near_.begin(), near_.end());
}

// The lists of pairs that are still near stay, and those of other pairs begin.
void BroadPhase::take_lists() {
  auto last = lists_.begin();
  for (PairList& pair : near_) {
    last = std::lower_bound(last, lists_.end(), pair);
    if (last != lists_.end() && !(pair < *last)) pair.list = std::move(last->list);
  }
  lists_.swap(near_);
}

void BroadPhase::find_between(PairList& pair, Foresight foresight, PairCounts& counts,
                              std::vector<SegmentPair>& out) {
  const int i = pair.i, j = pair.j;
  TendonBvh &a = tendons_[i], &b = tendons_[j];
  CandidateList& list = pair.list;
  const double most = foresight == Foresight::near ? kFarthest * sum_of_radii(a, b) : HUGE_VAL;
  double needed = list.needed(a, b, most);
  bool serves = list.serves(a, b, needed);
  const bool is_clear = serves && !list.any_within(needed);
  if (is_clear || (i == j && is_straight(a.tendon()))) {
    ++counts.skipped;
    return;
  }
  if (serves) {
    ++counts.skipped;
  } else {
    ++counts.searches;
    list.collect(a, b, most);
    needed = list.needed(a, b, most);
  }
  if (!list.any_within(needed)) return;
  NarrowPhase narrow{a, b, i, j, foresight, most, counts, out};
  for (const Candidate& s : list.candidates())
    if (!(s.distance > needed)) narrow.test(s.k, s.m);
}

namespace {

// Contact distance near anchors whose distance is less than the sum of radii.
//
// No force moves fixed anchors, or changes the distance of two anchors on one link. A contact between them
// has no solution. A contact next to them would bend both tendons as sharply as their segments allow.
// Therefore the contact distance increases gradually with the arc length. With the distance d of the anchors,
// and the arcs s and t from them to the contact points, it is
//
//   min(r_a + r_b, d + kParting (s + t))  [m].
//
// The same holds of an attachment and the shape of its link: no force changes their distance d, which is
// negative in the shape. A point at the arc s from it is at most at the distance d + s, so that a tendon with
// short segments could be at its radius r from the surface only if it were torn. The contact distance is
//
//   min(r, d + kParting s)  [m].

// Whether no force moves the anchor.
bool stays(const Anchor& h, const std::vector<Link>& links) {
  return h.link < 0 ? h.rigid : !links[h.link].yields();
}

// Rest length between particles first <= last, and from a particle to the point u of segment k [m].
double arc_between(const Tendon& c, int first, int last) {
  return std::accumulate(c.rest.begin() + first, c.rest.begin() + last, 0.0);
}
double arc_to(const Tendon& c, int particle, int k, double u) {
  return particle <= k ? arc_between(c, particle, k) + u * c.rest[k]
                       : (1 - u) * c.rest[k] + arc_between(c, k + 1, particle);
}

}  // namespace

bool keep_distance(const Anchor& h, const Anchor& g, const std::vector<Link>& links) {
  if (h.is_line || g.is_line) return false;
  const bool together = h.link >= 0 && h.link == g.link;
  return together || (stays(h, links) && stays(g, links));
}

bool keep_distance(const Anchor& h, int link, const std::vector<Link>& links) {
  return h.link == link || (stays(h, links) && !links[link].yields());
}

Stretch touching_part(const Tendon& c, int k, const std::vector<Departure>& departures) {
  Stretch part;
  for (const Departure& of : departures) {
    const bool before = of.particle <= k;
    double share = of.particle == k || of.particle == k + 1 ? kLeastEndWeight : 0.0;
    const double below = kLeastKept * c.radius - of.distance;
    if (below > 0) {
      const double within = below / kParting - arc_to(c, of.particle, k, before ? 0 : 1);
      share = std::max(share, within / c.rest[k]);
    }
    if (before)
      part.from = std::max(part.from, share);
    else
      part.to = std::min(part.to, 1 - share);
  }
  return part;
}

double contact_distance(const SegmentPair& p, const PairPoint& at, const Tendon& a, const Tendon& b,
                        const std::vector<Link>& links) {
  double apart = a.radius + b.radius;
  for (const Anchor& h : a.anchors)
    for (const Anchor& g : b.anchors) {
      if (!keep_distance(h, g, links)) continue;
      const double d = norm(h.target.aim - g.target.aim);
      if (d >= apart) continue;
      // Adjacent anchors of one tendon contradict no contact, because segments between them make none.
      const auto [first, last] = std::minmax(h.particle, g.particle);
      if (&a == &b && arc_between(a, first, last) < self_contact_arc(a.radius)) continue;
      const double arcs = arc_to(a, h.particle, p.segment_a, at.u) + arc_to(b, g.particle, p.segment_b, at.w);
      apart = std::min(apart, d + kParting * arcs);
    }
  return apart;
}

double contact_distance(const Tendon& c, int k, double u, const Departure& from) {
  if (from.distance >= c.radius) return c.radius;
  return std::min(c.radius, from.distance + kParting * arc_to(c, from.particle, k, u));
}

}  // namespace bt
