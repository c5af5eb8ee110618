// Which pairs of segments of tendons could touch within a step.
//
// Of every two tendons, and of every tendon with itself, a list of candidates is kept: all segments that are
// nearer to each other than a limit, but neighbours along the tendon. It is collected from both tendons'
// hierarchies of boxes (tendon_bvh.h), and serves until
//
//   reach + motion since then + motion foreseen in this step  >=  least distance of what it leaves out,
//
// motions being those of one tendon relative to the other. Each candidate that could touch, by the same
// inequality with its own distance, is tested (narrow_phase.h). So nothing depends on when a list was
// collected: what it leaves out could not touch.
#pragma once
#include <vector>

#include "collision/narrow_phase.h"

namespace bt {

// What the limit of a list is more than the reach of both tendons, in sums of radii [-]. More: lists serve
// for longer, and what lies side by side is on them, which makes steps slower. Less: they are collected more
// often. Where more than half of it is foreseen to be used up in one step, the list is for that step alone.
constexpr double kListMargin = 0.35;

struct Candidate {
  int k, m;
  double distance;  // at least, when it was collected [m]
};

// The candidates of two tendons, or of one with itself.
class CandidateList {
 public:
  // How near segments had to be when they were collected to touch within this step, each tendon moving
  // relative to the other by `most` at most within it [m].
  double needed(const TendonBvh& a, const TendonBvh& b, double most) const;
  bool serves(const TendonBvh& a, const TendonBvh& b, double needed) const;
  // Whether some candidate is as near as needed.
  bool any_within(double needed) const { return !(nearest_ > needed); }
  void collect(TendonBvh& a, TendonBvh& b, double most);
  const std::vector<Candidate>& candidates() const { return candidates_; }

 private:
  friend struct Collector;
  std::vector<Candidate> candidates_;
  double left_out_ = -1;           // least distance of what is not listed, when it was collected [m]
  double nearest_ = 0;             // least distance of what is [m]
  MotionBound a_moved_, b_moved_;  // then
  int a_rest_ = -1, b_rest_ = -1;  // TendonBvh::rest_set() then
};

class BroadPhase {
 public:
  // Forgets all lists: tendons were added, removed or changed.
  void clear();
  // Appends the pairs that could touch, by tendons, and of two tendons in blocks of segments. tendons: null
  // for those that are left out. threshold: distance of the surfaces at which contacts begin [m].
  PairCounts find(const std::vector<Tendon*>& tendons, double threshold, Foresight foresight,
                  std::vector<SegmentPair>& out);

 private:
  void find_between(int i, int j, Foresight foresight, PairCounts& counts, std::vector<SegmentPair>& out);
  std::vector<TendonBvh> tendons_;
  std::vector<CandidateList> lists_;  // of tendons i <= j at i + j (j + 1) / 2
  StraightStretches straight_;
};

}  // namespace bt
