// Algorithm 1: whether two segments of tendons could touch within a step, and where they are nearest.
#pragma once
#include <vector>

#include "bodies/link.h"
#include "collision/tendon_bvh.h"
#include "geometry/segment_distance.h"

namespace bt {

// A point of each segment: x_a + u (x_a+1 - x_a) and x_b + w (x_b+1 - x_b).
struct PairPoint {
  double u = 0, w = 0;
  Vec3 apart;  // from b to a [m], turned as they are predicted to turn together within the step
  double distance = 0;
  int end = 0;  // of the stretch along which they touch
};

struct SegmentPair {
  int tendon_a, segment_a, tendon_b, segment_b;
  PairPoint nearest;
  bool passes = false;    // as predicted they do not touch
  bool parallel = false;  // nearly: they touch at the ends of a stretch, else where they are nearest
  // Where they touch. An end at the second particle of a segment is left to the next segment.
  int count = 0;
  PairPoint points[2];
};

// Distance that the centrelines of a pair are kept at [m]: the sum of their radii, or less near held
// particles that are nearer than that (collision/broad_phase.cpp).
double contact_distance(const SegmentPair& p, const PairPoint& at, const Tendon& a, const Tendon& b,
                        const std::vector<Link>& links);

// What a search for pairs did.
struct PairCounts {
  long considered = 0;  // pairs of segments that were measured, because their boxes meet
  long near = 0;        // those of them that could touch within the step
  long searches = 0;    // pairs of tendons (each with itself too) whose candidates were collected anew
  long skipped = 0;     // those whose candidates served again, or that need none
  double room = 1;      // share of the step until tendons that are not near could touch, as foreseen [-]
};

// Which pairs could touch within a step: of what is within kFarthest; or of all, however far they move, but
// only where they approach (geometry/segment_distance.h).
enum class Foresight { near, swept };

// Whether a tendon as a whole runs so straight, now and, as foreseen, at the end of the step, that it cannot
// touch itself.
bool is_straight(const Tendon& c);

// Up to where a tendon runs so straight that it cannot touch itself: points an arc a apart are at least
// kStraight a apart, and kStraight kSelfContactArc exceeds two.
class StraightStretches {
 public:
  void find(TendonBvh& tendon);
  bool join(int k, int m) const { return m / kSegments <= to_[k / kSegments]; }

 private:
  static constexpr int kSegments = 8;  // in a stretch
  std::vector<int> to_;                // the last stretch, by stretch
  std::vector<Vec3> heading_;          // of each stretch's chord
  std::vector<double> agrees_;  // least cosine of another heading with it for all its segments to be straight
};

// Of two tendons, or of one where a is b.
struct NarrowPhase {
  TendonBvh &a, &b;
  const int slot_a, slot_b;
  const Foresight foresight;
  const StraightStretches* straight;  // of one tendon
  const double most;                  // relative motion that is foreseen at most [m]
  PairCounts& counts;
  std::vector<SegmentPair>& out;

  // Appends the segments k of a and m of b, if they could touch within the step.
  void test(int k, int m);

 private:
  PairPoint point(int k, int m, double u, double w) const;
  void find_points(SegmentPair& s, double reach) const;
  double motion(int k, int m) const;
  Sweep sweep(int k, int m) const;
};

}  // namespace bt
