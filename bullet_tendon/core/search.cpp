#include "search.h"

#include <algorithm>
#include <utility>

#include "constants.h"
#include "pairs.h"
#include "search_constants.h"
#include "swept_box.h"

namespace bt {

// In blocks of 64 by 64 segments, and these in blocks of 8 by 8.
uint64_t order_of(const NearSegments& s) {
  auto part = [](int segment, int shift, int bits) {
    return static_cast<uint64_t>(segment >> shift & ((1 << bits) - 1));
  };
  const uint64_t branches = part(s.k, 6, 16) << 16 | part(s.m, 6, 16);
  const uint64_t leaves = part(s.k, 3, 3) << 3 | part(s.m, 3, 3);
  return branches << 12 | leaves << 6 | part(s.k, 0, 3) << 3 | part(s.m, 0, 3);
}

void put_in_order(std::vector<NearSegments>& all) {
  std::sort(all.begin(), all.end(),
            [](const NearSegments& p, const NearSegments& q) { return order_of(p) < order_of(q); });
}

// Goes down both trees where bounds are not enough.
struct Seeker {
  const Searched &a, &b;
  const Strands &ta, &tb;
  PairSearch& found;
  const double reach, least_room;
  const bool self = a.chain == b.chain;
  double upper = 1e300;  // the least distance is no more than that [m]
  double wanted = 0;     // what is farther than that is of no concern [m]
  bool lists = false;

  bool too_near() const { return !lists && upper - reach < least_room; }

  void bound(double most) {
    if (lists || most >= upper) return;
    upper = most, wanted = reach + kRoomKept * (upper - reach);
  }
  // false: all of it is far enough away.
  bool concerns(double least) {
    if (least < wanted) return true;
    found.floor_ = std::min(found.floor_, least);
    return false;
  }

  bool joined(int k, int m) const { return self && a.joins(k, m); }
  bool all_joined(const Strand& p, const Strand& q) const { return joined(p.first, q.last - 1); }
  double least_of_straight(double straight, double stretch) const {
    return straight * stretch * a.joined_arc();
  }

  void within(int i) {
    const Strand& p = ta[i];
    if (too_near() || all_joined(p, p)) return;
    if (p.straight > 0 && !concerns(least_of_straight(p.straight, p.stretch))) return;
    if (p.second < 0) return segments(p, p);
    within(i + 1), within(p.second), both(i + 1, p.second);
  }

  // Of one tendon: i comes before j.
  void both(int i, int j) {
    const Strand &p = ta[i], &q = tb[j];
    if (too_near() || all_joined(p, q)) return;
    const double distance = between(p, q), radii = p.radius + q.radius;
    if (!concerns(distance - radii)) return;
    if (self && p.last == q.first) {
      Vec3 heading;
      const double straight = straightness_of_both(p, q, heading);
      if (straight > 0 && !concerns(least_of_straight(straight, std::min(p.stretch, q.stretch)))) return;
    }
    if (!self || !joined(p.last - 1, q.first)) bound(distance + radii);
    if (p.second < 0 && q.second < 0) return segments(p, q);
    if (divides_first(p, q))
      both(i + 1, j), both(p.second, j);
    else
      both(i, j + 1), both(i, q.second);
  }

  void segments(const Strand& p, const Strand& q) {
    const Field &x = a.chain->x, &y = b.chain->x;
    for (int k = p.first; k < p.last; ++k)
      for (int m = &p == &q ? k + 2 : q.first; m < q.last; ++m) {
        if (joined(k, m)) continue;
        const double distance = between_segments(x, k, y, m);
        bound(distance);
        if (concerns(distance)) {
          if (lists)
            found.listed_.push_back({k, m, distance});
          else
            found.floor_ = std::min(found.floor_, distance);
        }
      }
  }
};

double Searched::joined_arc() const { return kSelfContactArc * chain->radius; }

void Searched::look(const Chain& c, double threshold) {
  chain = &c;
  coursed_ = averaged_ = false;
  boxed_.clear();
  strands_.look(c.n() - 1);
  travel.look(c.x, c.foreseen, c.most_slack, c.radius + 0.5 * threshold);
  if (std::exchange(rest_set_, c.rest_set) == c.rest_set) return;
  arc_.assign(c.n(), 0.0);
  for (int k = 0; k + 1 < c.n(); ++k) arc_[k + 1] = arc_[k] + c.rest[k];
}

const Strands& Searched::strands() {
  strands_.fit_all(*chain);
  return strands_;
}

const Courses& Searched::courses() {
  if (!std::exchange(coursed_, true)) courses_.look(*chain, strands_);
  return courses_;
}

const Box& Searched::box(int segment) {
  if (boxed_.empty()) boxed_.assign(chain->n() - 1, 0), boxes_.resize(chain->n() - 1);
  if (!std::exchange(boxed_[segment], 1))
    boxes_[segment] = swept_box(*chain, segment, mean_motion(), travel.skin());
  return boxes_[segment];
}

Vec3 Searched::mean_motion() {
  if (std::exchange(averaged_, true)) return mean_motion_;
  const Chain& c = *chain;
  mean_motion_ = {};
  for (int i = 0; i < c.n(); ++i) mean_motion_ += (1.0 / c.n()) * (c.foreseen.at(i) - c.x.at(i));
  return mean_motion_;
}

double Searched::farthest() {
  const Chain& c = *chain;
  const Vec3 mean = mean_motion();
  double square = 0;
  for (int i = 0; i < c.n(); ++i) {
    const Vec3 off = c.foreseen.at(i) - mean - c.x.at(i);
    square = std::max(square, dot(off, off));
  }
  return std::sqrt(square);
}

bool Searched::is_straight() {
  return bt::is_straight(*chain, chain->x) && bt::is_straight(*chain, chain->foreseen);
}

double PairSearch::moved(const Searched& a, const Searched& b) const {
  const Vec3 apart = a.travel.gone() - b.travel.gone() - gone_;
  return norm(apart) + (a.travel.gone_off() + b.travel.gone_off() - off_);
}

Found PairSearch::look(Searched& a, Searched& b, double reach, long now, long& searches) {
  if (holds(a, b)) {
    within_ = (1 + kRoundedUp) * (reach + moved(a, b));
    if (within_ < floor_) return within_ >= least_ ? Found::listed : Found::nothing;
  }
  if (known_)
    waits_ = now - searched_ > kLooksWorth ? 0 : wait_ = std::min(2 * wait_ + kLooksWorth, kLongestWait);
  known_ = waits_ == 0;
  if (!known_) return --waits_, Found::watched;
  front.forget();
  search(a, b, reach), ++searches;
  searched_ = now;
  within_ = (1 + kRoundedUp) * reach;
  return within_ >= least_ ? Found::listed : Found::nothing;
}

void PairSearch::search(Searched& a, Searched& b, double reach) {
  for (Searched* s : {&a, &b})
    if (s->travel.since_settled() > kSettled * s->chain->radius) s->travel.settle(s->chain->x);
  gone_ = a.travel.gone() - b.travel.gone();
  off_ =
      a.travel.gone_off() + b.travel.gone_off() - 2 * (a.travel.since_settled() + b.travel.since_settled());
  rest_a_ = a.chain->rest_set, rest_b_ = b.chain->rest_set;
  const double radii = a.chain->radius + b.chain->radius;
  Seeker seeker{a, b, a.strands(), b.strands(), *this, reach, kLeastRoom * radii};
  auto seek = [&] {
    listed_.clear(), floor_ = 1e300;
    if (seeker.self)
      seeker.within(0);
    else
      seeker.both(0, 0);
  };
  const double most =
      seeker.self ? std::max(a.joined_arc(), reach + seeker.least_room) : reach + kMostRoom * radii;
  seeker.bound(most);
  seek();
  if (seeker.too_near()) {
    seeker.lists = true, seeker.wanted = reach + kListedRoom * radii;
    seek();
    put_in_order(listed_);
  }
  least_ = 1e300;
  for (const NearSegments& s : listed_) least_ = std::min(least_, s.distance);
  clear_ = (1 - kRoundedUp) * std::min(floor_, least_);
}

}  // namespace bt
