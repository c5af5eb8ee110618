// Narrow phase (paper, algorithm 1): whether two tendon segments could touch within a step, and their nearest
// points.
#pragma once
#include <vector>

#include "bodies/link.h"
#include "collision/tendon_bvh.h"
#include "geometry/segment_distance.h"

namespace bt {

// A point of each segment: x_a + u (x_a+1 - x_a) and x_b + w (x_b+1 - x_b).
struct PairPoint : PairParameters {
  Vec3 apart;           // from b to a, turned by the predicted common rotation of both within the step [m]
  double distance = 0;  // [m]
  int end = 0;          // which end of the stretch along which they touch
};

struct SegmentPair {
  int tendon_a, segment_a, tendon_b, segment_b;
  PairPoint nearest;
  bool parallel = false;  // nearly parallel: contacts at the ends of a stretch, else at the nearest points
  // Contact points. An end at the second particle of a segment belongs to the next segment.
  int count = 0;
  PairPoint points[2];
  double room = 1;  // predicted share of the step before they could touch, if they are not near [-]
};

// Whether no force changes the distance of two anchors: they are on one link, or neither moves.
bool keep_distance(const Anchor& h, const Anchor& g, const std::vector<Link>& links);
// The same of an anchor and a link.
bool keep_distance(const Anchor& h, int link, const std::vector<Link>& links);
// Smallest weight of a free particle for a contact on a segment whose other end is anchored rigidly [-]. At
// the anchor the distance is given, so that the nearer to it the contact, the larger the force would be that
// turns the segment about it, without limit where the anchor is at the surface.
constexpr double kLeastEndWeight = 0.25;
// Beside an anchor inside, it is outside where it keeps this share of its radius: a point in the surface
// itself has no normal.
constexpr double kLeastKept = 0.01;
// A particle that is anchored to the link of a shape, or rests as that does; and its distance from the shape,
// negative inside, if it is attached to that link and the distance matters, else infinite [m].
struct Departure {
  int particle;
  double distance = HUGE_VAL;
};
// The part of segment k that can touch a shape from which the tendon departs: away from its ends that are
// anchored, and outside. Empty (from >= to): none.
Stretch touching_part(const Tendon& c, int k, const std::vector<Departure>& departures);
// Distance of the centrelines of a pair in contact [m]: the sum of the radii, or less near anchors that are
// nearer to each other than that (collision/broad_phase.cpp).
double contact_distance(const SegmentPair& p, const PairPoint& at, const Tendon& a, const Tendon& b,
                        const std::vector<Link>& links);
// Distance of the point u of segment k from a shape that it touches [m]: the radius, or less near an
// attachment to the link of the shape that is nearer to it than that.
double contact_distance(const Tendon& c, int k, double u, const Departure& from);

// Statistics of a search for pairs.
struct PairCounts {
  long considered = 0;  // pairs of segments that were measured because their boxes overlap
  long near = 0;        // those of them that could touch within the step
  long searches = 0;    // pairs of tendons (also with themselves) whose candidates were collected
  long skipped = 0;     // pairs of tendons that are apart, with valid lists, or that need none
};

// near: relative motions of at most kFarthest sums of radii (collision/broad_phase.cpp). swept: any motion,
// but only pairs that approach each other (geometry/segment_distance.h).
enum class Foresight { near, swept };

// Whether the whole tendon is too straight to touch itself, at present and at the predicted end of the step.
bool is_straight(const Tendon& c);

// Tests pairs of segments of two tendons, or of one tendon (a is b).
struct NarrowPhase {
  const TendonBvh &a, &b;
  const int slot_a, slot_b;
  const Foresight foresight;
  const double most;  // limit of the predicted relative motion [m]
  PairCounts& counts;
  std::vector<SegmentPair>& out;
  const bool self = &a == &b;

  // Appends the pair of segment k of a and segment m of b if they could touch within the step.
  void test(int k, int m);

 private:
  PairPoint point(int k, int m, PairParameters at) const;
  void find_points(SegmentPair& s, double reach) const;
  double motion(int k, int m) const;
  Sweep sweep(int k, int m) const;
};

}  // namespace bt
