// How far two segments can go within a step before they touch, as they are foreseen to move.
#pragma once
#include "vec.h"

namespace bt {

// Ends of a, then of b, at the start, and where they go [m].
struct Sweep {
  Vec3 from[4], way[4];
  Vec3 before, after;  // unit vectors: as one turns into the other, so do the segments

  Sweep() = default;
  Sweep(const Vec3 (&start)[4], const Vec3 (&end)[4]);
  // `chord` and `chord_after` are what keeps its length between the segments, which turn with it: that
  // brings them no nearer, and is taken off the way.
  void unturn(Vec3 chord, Vec3 chord_after);
  // A vector of the start, turned like that.
  Vec3 turned(Vec3 v) const;
  // Share of the way until they are within `enough` of each other; 1: they never are.
  double share_apart(double enough) const;

 private:
  Vec3 apart_at(double share) const;
};

}  // namespace bt
