// Broad phase: the pairs of tendon segments that could touch within a step.
//
// Tendons are sorted along the axis in which they are spread most. Those whose boxes overlap, grown by reach
// and predicted motion, are pairs (sweep and prune). A pair, and every tendon with itself, has a list of
// candidates: all pairs of segments nearer to each other than a limit, except neighbours along the tendon.
// The list is collected from the bounding volume hierarchies of both tendons (tendon_bvh.h). It is valid
// until
//
//   reach + motion since then + motion predicted in this step  >=  least distance of the pairs not listed.
//
// Motions are those of one tendon relative to the other. A candidate that could touch, by the same inequality
// with its own distance, is tested (narrow_phase.h). Pairs that are not listed cannot touch. Therefore the
// result does not depend on when a list was collected.
#pragma once
#include <vector>

#include "collision/collision_filter.h"
#include "collision/narrow_phase.h"

namespace bt {

// Margin of the limit of a list over the reach of both tendons, in sums of radii [-]. Larger: lists are valid
// for longer, but contain tendons that lie side by side, which makes steps slower. Smaller: lists are
// collected more often. Where one step is predicted to use more than half of it, the list is collected for
// that step only.
constexpr double kListMargin = 0.35;

struct Candidate {
  int k, m;
  double distance;  // lower bound at the time of collection [m]
};

// The candidates of two tendons, or of one tendon with itself.
class CandidateList {
 public:
  // Greatest distance at the time of collection of segments that can touch within this step [m]. `most`:
  // limit of the relative motion of the tendons within the step [m].
  double needed(const TendonBvh& a, const TendonBvh& b, double most) const;
  // Whether the list contains all pairs that were nearer than `needed`.
  bool serves(const TendonBvh& a, const TendonBvh& b, double needed) const;
  // Whether a candidate is within the distance `needed` [m].
  bool any_within(double needed) const { return !(nearest_ > needed); }
  void collect(TendonBvh& a, TendonBvh& b, double most);
  const std::vector<Candidate>& candidates() const { return candidates_; }

 private:
  friend struct Collector;
  std::vector<Candidate> candidates_;
  double left_out_ = -1;           // least distance of the pairs not listed, at collection [m]
  double nearest_ = 0;             // least distance of the candidates, at collection [m]
  MotionBound a_moved_, b_moved_;  // at collection
  int a_rest_ = -1, b_rest_ = -1;  // TendonBvh::rest_set() at collection
};

class BroadPhase {
 public:
  // Deletes all lists, because tendons were added, removed or changed.
  void clear();
  // Appends the pairs that could touch, ordered by tendons, then by segments. tendons: null entries
  // are left out, and pairs that `filter` excludes. threshold: distance of the surfaces at which contacts
  // begin [m].
  PairCounts find(const std::vector<Tendon*>& tendons, const CollisionFilter& filter, double threshold,
                  Foresight foresight, std::vector<SegmentPair>& out);

 private:
  struct Extent {
    int tendon;
    Box box;  // around it, grown by what it can reach in the step [m]
  };
  // The list of tendons i <= j.
  struct PairList {
    int i, j;
    CandidateList list;
    bool operator<(const PairList& other) const { return i != other.i ? i < other.i : j < other.j; }
  };

  void find_near(const CollisionFilter& filter);
  void take_lists();
  void find_between(PairList& pair, Foresight foresight, PairCounts& counts, std::vector<SegmentPair>& out);

  std::vector<TendonBvh> tendons_;
  std::vector<Extent> extents_;  // of the tendons of this step
  std::vector<PairList> lists_;  // of the pairs that were near in the last step, in order
  std::vector<PairList> near_;   // the pairs that are near in this one
};

}  // namespace bt
