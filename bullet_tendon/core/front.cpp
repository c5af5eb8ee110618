#include "front.h"

#include "pairs.h"
#include "search.h"
#include "search_constants.h"

namespace bt {

namespace {

// What is that far away never comes near [m].
constexpr double kNowhere = 1e9;

StrandPair pair_of(int i, int j) {
  StrandPair pair;
  pair.i = i, pair.j = j;
  return pair;
}

}  // namespace

// One look.
struct Watch {
  Searched &a, &b;
  const Courses &of_a, &of_b;
  const double reach, most;
  Front& front;
  std::vector<StrandPair>& near;
  const bool self = a.chain == b.chain;
  const double least_room = kLeastRoom * (a.chain->radius + b.chain->radius);

  // What they near each other by within the step, as foreseen.
  double nearing(const StrandPair& s) const {
    const Travel &p = of_a[s.i].way, &q = of_b[s.j].way;
    return std::min(most, norm(p.by - q.by) + p.off + q.off);
  }
  // What is left of the distance between them.
  double room(const StrandPair& s) const {
    const Travel &p = of_a[s.i].gone, &q = of_b[s.j].gone;
    return s.clear - norm(p.by - q.by - s.gone) - (p.off + q.off - s.gone_off);
  }

  void keep(StrandPair s, double clear) {
    const Travel &p = of_a[s.i].gone, &q = of_b[s.j].gone;
    s.clear = (1 - kRoundedUp) * clear, s.gone = p.by - q.by, s.gone_off = p.off + q.off;
    front.pairs_.push_back(s), front.due_.push_back(front.path_ + s.clear);
  }

  bool joined(int k, int m) const { return self && a.joins(k, m); }

  // As far as bounds tell.
  double distance_of(StrandPair& s, const Strand& p, const Strand& q) const {
    const double apart = s.i == s.j && self ? 0 : between(p, q) - p.radius - q.radius;
    if (!self || (s.i != s.j && p.last != q.first)) return apart;
    Vec3 heading;
    const double straight = s.i == s.j ? p.straight : straightness_of_both(p, q, heading);
    s.by_arc = true;
    return std::max(apart, straight * std::min(p.stretch, q.stretch) * a.joined_arc());
  }
  double distance_of_segments(StrandPair& s, const Strand& p, const Strand& q) const {
    const Field &x = a.chain->x, &y = b.chain->x;
    double least = kNowhere;
    s.by_arc = false;
    for (int k = p.first; k < p.last; ++k)
      for (int m = self && s.i == s.j ? k + 1 : q.first; m < q.last; ++m) {
        if (joined(k, m))
          s.by_arc = true;
        else
          least = std::min(least, between_segments(x, k, y, m));
      }
    return least;
  }

  // What is far enough apart to be so for a while is kept, the rest divided.
  void measure(StrandPair s) {
    const Strand &p = a.strand(s.i), &q = b.strand(s.j);
    const double moves = nearing(s), wanted = reach + moves + std::max(least_room, kLooksWorth * moves);
    if (joined(p.first, q.last - 1)) return s.by_arc = true, keep(s, kNowhere);
    const double distance = distance_of(s, p, q);
    if (distance > wanted) return keep(s, distance);
    if (p.second >= 0 || q.second >= 0) return divide(s, p, q);
    const double least = distance_of_segments(s, p, q);
    if (least <= wanted) s.waits = kLooksWorth;
    if (least <= reach + moves) near.push_back(s);
    keep(s, least);
  }

  void divide(const StrandPair& s, const Strand& p, const Strand& q) {
    if (self && s.i == s.j) {
      measure(pair_of(s.i + 1, s.i + 1)), measure(pair_of(p.second, p.second));
      measure(pair_of(s.i + 1, p.second));
    } else if (divides_first(p, q)) {
      measure(pair_of(s.i + 1, s.j)), measure(pair_of(p.second, s.j));
    } else {
      measure(pair_of(s.i, s.j + 1)), measure(pair_of(s.i, q.second));
    }
  }
};

void Front::follow(Searched& a, Searched& b) {
  const Travel &p = a.courses()[0].gone, &q = b.courses()[0].gone, last = last_;
  last_ = {p.by - q.by, p.off + q.off};
  path_ += norm(last_.by - last.by) + (last_.off - last.off);
}

void Front::start(Searched& a, Searched& b) {
  forget(), anew_.push_back({});
  follow(a, b), path_ = 0;
}

void Front::look(Searched& a, Searched& b, double reach, double most, std::vector<StrandPair>& near) {
  const bool made = pairs_.empty() || pairs_.size() > kMostGrown * built_;
  const bool reeled = rest_a_ != a.chain->rest_set || rest_b_ != b.chain->rest_set;
  rest_a_ = a.chain->rest_set, rest_b_ = b.chain->rest_set;
  anew_.clear();
  if (made)
    start(a, b);
  else
    follow(a, b);
  Watch watch{a, b, a.courses(), b.courses(), reach, most, *this, near};
  const double goes = path_ + reach + watch.nearing({});
  size_t kept = 0;
  for (size_t k = 0; k < pairs_.size(); ++k) {
    if (due_[k] > goes && !reeled) {
      if (kept < k) pairs_[kept] = pairs_[k], due_[kept] = due_[k];
      ++kept;
      continue;
    }
    StrandPair s = pairs_[k];
    const double room = watch.room(s);
    const bool holds = !(reeled && s.by_arc), clear = holds && reach + watch.nearing(s) < room;
    if (!clear && (!holds || s.waits == 0)) {
      anew_.push_back(pair_of(s.i, s.j));
      continue;
    }
    if (!clear) near.push_back(s);
    if (s.waits > 0) --s.waits;
    pairs_[kept] = s, due_[kept++] = path_ + room;
  }
  pairs_.resize(kept), due_.resize(kept);
  for (const StrandPair& s : anew_) watch.measure(s);
  if (made) built_ = pairs_.size();
}

}  // namespace bt
