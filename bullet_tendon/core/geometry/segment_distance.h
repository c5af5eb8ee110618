// Nearest points of two segments.
#pragma once
#include "math/vec3.h"

namespace bt {

// Square of the sine between two segments over which their nearest points are followed [-]. Smaller: those of
// nearly parallel ones run to and fro.
constexpr double kCrossing = 3e-2;

// Nearest parameters of segments p0-p1 and q0-q1: p0 + u (p1 - p0) and q0 + w (q1 - q0).
void nearest_parameters(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, double& u, double& w);

double segment_distance(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1);

// Of nearly parallel segments, what is nearest jumps from one end of their overlap to the other as they turn
// by nothing, and they with it. Ends that are farther apart than the nearest points by less than `enough` [m]
// draw these towards them, so that they move as the segments turn.
void between_ends(Vec3 p0, Vec3 p1, Vec3 q0, Vec3 q1, double enough, double& u, double& w);

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
  Vec3 apart_at(double share) const;
};

}  // namespace bt
