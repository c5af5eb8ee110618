// Algorithm 1: which segments of tendons are near each other, and where.
#pragma once
#include <vector>

#include "chain.h"
#include "crowd.h"
#include "link.h"

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

// Distance that the centrelines of a pair are kept at [m]: the sum of their radii, or less near held
// particles that are nearer than that (held_ends.cpp).
double kept_apart(const SegmentPair& p, const Chain& a, const Chain& b, const std::vector<Link>& links);

// Whether a tendon as a whole would run so straight at x that it cannot touch itself.
bool is_straight(const Chain& c, const Field& x);

// Whether any particle ends up elsewhere than foreseen.
bool strays(const Chain& c);

// Up to where a tendon runs so straight that it cannot touch itself: points an arc a apart are at least
// kStraight a apart, and kStraight kSelfContactArc exceeds two.
class Straight {
 public:
  static constexpr int kLeaf = 8;  // segments
  // `off`: what particles move by within the step besides what all of them do [m].
  void find(const Chain& c, double off);
  bool joins(int k, int m) const { return m / kLeaf <= to_[k / kLeaf]; }

 private:
  std::vector<int> to_;         // the last leaf, by leaf
  std::vector<Vec3> heading_;   // of each leaf's chord
  std::vector<double> agrees_;  // least cosine of another heading with it for all its segments to be straight
};

struct PairCounts {
  // Segments; tendons, each with itself too, that were searched, and that could not have come near since.
  long considered = 0, near = 0, searches = 0, skipped = 0;
  double room = 1;  // share of the step until tendons that are not near could touch, as foreseen [-]
};

// Which pairs could touch within a step: of what is within kFarthest; of all, however far they move; and
// of these only where they approach (sweep.h).
enum class Foresight { near, far, swept };

// Finds the pairs of segments that could touch within the step.
class PairFinder {
 public:
  // Forgets where tendons were.
  void clear();
  // Appends them. threshold: that contacts begin at beyond the surfaces [m].
  PairCounts find(const std::vector<Chain*>& chains, double threshold, Foresight foresight,
                  std::vector<SegmentPair>& out);

 private:
  bool all_clear() const;
  void find_of(int i, int j, Foresight foresight, PairCounts& counts, std::vector<SegmentPair>& out);
  void list_near(Searched& a, Searched& b, Found found, PairSearch& search, double most);
  std::vector<Searched> tendons_;
  std::vector<PairSearch> searches_;  // by slot_of
  Crowd crowd_;
  long looks_ = 0;
  Straight straight_;
  std::vector<StrandPair> leaves_;
  std::vector<NearSegments> near_;
};

}  // namespace bt
