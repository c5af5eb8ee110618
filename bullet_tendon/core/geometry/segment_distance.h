// Nearest points of two segments.
#pragma once
#include <algorithm>

#include "math/vec3.h"

namespace bt {

// A part of a segment, from 0 at its first particle to 1 at its second.
struct Stretch {
  double from = 0, to = 1;  // [-]

  // Of a point of the part, from 0 to 1: where it is in the segment; and back, of the point nearest to it.
  double whole(double u) const { return from + u * (to - from); }
  double part(double u) const { return std::min(std::max((u - from) / (to - from), 0.0), 1.0); }
};

// Largest number of steps of a search for nearest points that alternates between two features, or of an
// advance of two segments until they could touch [-]. Fewer: points are less accurate, and substeps are cut
// because of what passes by. More: slower where features are nearly parallel.
constexpr int kAdvances = 8;

// A pair of points of segments p0-p1 and q0-q1: p0 + u (p1 - p0) and q0 + w (q1 - q0).
struct PairParameters {
  double u = 0, w = 0;
};

PairParameters nearest_parameters(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1);
// From the point of q to that of p.
inline Vec3 apart_at(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, PairParameters at) {
  return (1 - at.u) * p0 + at.u * p1 - ((1 - at.w) * q0 + at.w * q1);
}
double segment_distance(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1);

// Nearly parallel segments touch along a stretch, and their nearest points jump from one of its ends to the
// other when the segments turn by rounding. Gives the ends of this stretch, in the order of p, and returns
// how many there are: 2, or 1 where they coincide, or 0 if the segments are not nearly parallel. Where the
// segments cross within the stretch, its ends lie so near to the crossing that at least one of them is not
// farther apart than the nearest points by more than `sag` [m].
// A segment that is much shorter than the distance of both, as where a slack tendon is pushed together, also
// has nearest points that jump from end to end. Its stretch is the whole segment, in its own order.
// distance: of the segments [m].
int touching_stretch(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, double distance, double sag,
                     PairParameters (&ends)[2]);

// Two segments whose ends move along straight lines.
struct Sweep {
  Vec3 from[4], way[4];  // ends of a, then of b: at the start, and their displacements [m]
  Vec3 before, after;    // unit vectors: as one turns into the other, so do the segments

  Sweep() = default;
  Sweep(const Vec3 (&start)[4], const Vec3 (&end)[4]);
  // `chord` and `chord_after` are what keeps its length between the segments, which turn with it: that
  // brings them no nearer, and is taken off the displacements.
  void unturn(Vec3 chord, Vec3 chord_after);
  // A vector of the start, turned like that.
  Vec3 turned(Vec3 v) const;
  // Share of the displacements until they are within `enough` of each other; 1: they never are. By
  // conservative advancement (Mirtich 1996): what is nearest lies between two planes, which approach each
  // other no faster than the segments' ends do along their normal.
  double share_apart(double enough) const;

 private:
  Vec3 nearest_apart(double share) const;
};

}  // namespace bt
