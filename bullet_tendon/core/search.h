// Which segments of two tendons, or of one with itself, have to be looked at: found once, and kept until they
// have moved.
//
// A search finds how near the tendons are to each other: none of their segments but those that it lists are
// nearer than `floor`. They come nearer by no more than they move, less what both do alike (travel.h). So
// as long as what could touch has to be within floor less that motion, a comparison is all there is to do.
// What is listed are segments so near that they may touch soon, with their distance. Where searches do not
// last, because something moves fast, stretches are watched one by one instead (front.h), for a while.
//
// Nothing depends on when a search was made: what is left out could not touch.
#pragma once
#include <cstdint>

#include "box.h"
#include "constants.h"
#include "front.h"
#include "strands.h"
#include "travel.h"

namespace bt {

// No less than its length, and sooner told.
inline double size_of(Vec3 v) { return std::fabs(v.x) + std::fabs(v.y) + std::fabs(v.z); }

struct NearSegments {
  int k = 0, m = 0;
  double distance = 0;  // when it was listed [m]
};
// However they were found, they are gone through in one order.
uint64_t order_of(const NearSegments& s);
void put_in_order(std::vector<NearSegments>& all);

// A tendon as searches see it.
class Searched {
 public:
  const Chain* chain = nullptr;
  Traveller travel;
  // threshold: that contacts begin at beyond the surfaces [m].
  void look(const Chain& c, double threshold);
  // Around where it is now; made when they are needed.
  const Strands& strands();
  const Strand& strand(int at) { return strands_.fit(*chain, at); }
  const Courses& courses();
  // Of a segment (swept_box.h).
  const Box& box(int segment);
  // Rest length between two segments, k before m [m].
  double arc_between(int k, int m) const { return arc_[m] - arc_[k + 1]; }
  // Segments that a spring joins, or so near along the tendon that no bend brings them together.
  bool joins(int k, int m) const { return m - k <= 1 || arc_between(k, m) < joined_arc(); }
  double joined_arc() const;  // [m]
  // Of its particles within the step, as foreseen, and the most that one moves besides [m].
  Vec3 mean_motion();
  double farthest();
  // It cannot touch itself, neither now nor, as foreseen, at the end of the step.
  bool is_straight();

 private:
  Strands strands_;
  Courses courses_;
  std::vector<Box> boxes_;
  std::vector<char> boxed_;
  bool coursed_ = false, averaged_ = false;
  Vec3 mean_motion_;
  std::vector<double> arc_;  // rest length up to each particle [m]
  int rest_set_ = -1;
};

// Of two tendons, i <= j, where all pairs of some are kept one after the other.
inline size_t slot_of(size_t i, size_t j) { return i + j * (j + 1) / 2; }

enum class Found { nothing, listed, watched };

class PairSearch {
 public:
  // Nothing can be near: what is cheap to tell, and mostly enough.
  bool stays_clear(const Searched& a, const Searched& b) const {
    const Traveller &p = a.travel, &q = b.travel;
    const double ways = size_of(p.way().by - q.way().by) + (p.way().off + q.way().off);
    return p.reach() + q.reach() + ways < room(a, b) && holds(a, b);
  }
  // What is left of the distance between them, for their reaches and for what they will move [m].
  double room(const Searched& a, const Searched& b) const {
    const Traveller &p = a.travel, &q = b.travel;
    return clear_ - size_of(p.gone() - q.gone() - gone_) - (p.gone_off() + q.gone_off() - off_);
  }
  // Where to find what is within `reach` now, in the look of that number. Searches anew where it has to, and
  // counts that.
  Found look(Searched& a, Searched& b, double reach, long now, long& searches);
  template <class Do>
  void each_listed(Do what) const {
    for (const NearSegments& s : listed_)
      if (s.distance <= within_) what(s.k, s.m);
  }

  Front front;  // where that is what is found

 private:
  friend struct Seeker;
  bool holds(const Searched& a, const Searched& b) const {
    return known_ && rest_a_ == a.chain->rest_set && rest_b_ == b.chain->rest_set;
  }
  double moved(const Searched& a, const Searched& b) const;
  void search(Searched& a, Searched& b, double reach);
  bool known_ = false;
  double floor_ = 0, least_ = 0;  // [m]; least: of those listed
  double clear_ = 0;              // the lesser of both, but for rounding
  double within_ = 0;             // what of them is to be looked at [m]
  int rest_a_ = 0, rest_b_ = 0;   // which rest lengths
  Vec3 gone_;                     // of a less that of b,
  double off_ = 0;                // and the sum of both, then
  long searched_ = 0;             // the look
  int waits_ = 0, wait_ = 0;      // looks until the next search, where they do not last; and at the last time
  std::vector<NearSegments> listed_;
};

}  // namespace bt
