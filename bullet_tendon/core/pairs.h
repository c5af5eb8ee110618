// Algorithm 1: which segments of tendons are near each other, and where.
#pragma once
#include <vector>

#include "chain.h"

namespace bt {

struct SegmentPair {
  int chain_a, segment_a, chain_b, segment_b;
  double u, w;  // nearest points: x_a + u (x_a+1 - x_a), x_b + w (x_b+1 - x_b)
  Vec3 apart;   // from b to a [m], turned as they are foreseen to turn together within the step
  double distance;
  bool passes = false;  // as foreseen they do not touch
};

// Nearest parameters of segments p0-p1 and q0-q1.
void nearest_parameters(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, double& u, double& w);

struct Box {
  Vec3 lo{1e300, 1e300, 1e300}, hi{-1e300, -1e300, -1e300};
  void include(Vec3 p) {
    lo = {std::min(lo.x, p.x), std::min(lo.y, p.y), std::min(lo.z, p.z)};
    hi = {std::max(hi.x, p.x), std::max(hi.y, p.y), std::max(hi.z, p.z)};
  }
  void include(const Box& b) { include(b.lo), include(b.hi); }
  void grow(double margin) {
    Vec3 m{margin, margin, margin};
    lo -= m, hi += m;
  }
};
inline bool overlap(const Box& a, const Box& b, double m = 0) {  // within the margin m
  return a.lo.x <= b.hi.x + m && b.lo.x <= a.hi.x + m && a.lo.y <= b.hi.y + m && b.lo.y <= a.hi.y + m &&
         a.lo.z <= b.hi.z + m && b.lo.z <= a.hi.z + m;
}

// Boxes around where a chain's segments are and, as foreseen, will be at the end of the step, relative
// to the chain's mean motion, grown by radius, slack and half the threshold: one for each, one for every
// eight, one for all.
struct BoxTree {
  static constexpr int kLeaf = 8;
  std::vector<Box> segments, leaves, branches;
  std::vector<double> arc;  // rest length up to each particle [m]
  // The last leaf up to which the tendon runs so straight from leaf i on that it cannot touch itself:
  // points an arc a apart are at least kStraight a apart, and kStraight kSelfContactArc exceeds two.
  std::vector<int> straight_to;
  Vec3 mean_motion;  // of the particles within the step [m]
  double skin = 0;   // radius and half the threshold [m]
  Box all;
  void refit(const Chain& c, double threshold);

 private:
  void find_straight(const Chain& c);
  double farthest_ = 0;         // that a particle moves relative to the mean motion [m]
  std::vector<Vec3> heading_;   // of each leaf's chord
  std::vector<double> agrees_;  // least cosine of another heading with it for all its segments to be straight
};

// Whether a tendon as a whole would run so straight at x that it cannot touch itself.
bool is_straight(const Chain& c, const Field& x);

// Whether any particle ends up elsewhere than foreseen.
bool strays(const Chain& c);

// Around all that a tendon could touch within the step: two tendons whose boxes are apart have no pair that
// find_pairs would find.
Box box_of_reach(const Chain& c, double threshold);

struct PairCounts {
  long considered = 0, near = 0;
  double room = 1;  // share of the step until tendons that are not near could touch, as foreseen [-]
};

// Which pairs could touch within a step: of what is within kFarthest; of all, however far they move; and
// of these only where they approach (sweep.h).
enum class Foresight { near, far, swept };

// Appends the pairs of segments that could touch within the step.
PairCounts find_pairs(const std::vector<Chain*>& chains, const std::vector<BoxTree>& trees,
                      Foresight foresight, std::vector<SegmentPair>& out);

}  // namespace bt
