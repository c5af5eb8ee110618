// A segment that bends as its tendon turns at its ends.
//
//   p(u) = start + u l + (u - 1/2)^2 / 2 d    u in [0, 1]; l = end - start, d = d_0 up to the middle, then
//   d_1
//
// d_i = x_(i-1) - 2 x_i + x_(i+1). This is the quadratic B-spline whose control points are the particles (de
// Boor, A Practical Guide to Splines, 1978): it touches every segment at its middle, and has one tangent
// everywhere. A chord cannot bend around an edge: it would be felt as a turn at one of its ends.
#pragma once
#include "math/vec3.h"

namespace bt {

// Bulge at an end of a segment, which is a particle, over the second difference there [-].
constexpr double kBulgeAtEnd = 0.125;

// Bulge or difference of distances along a segment, over the radius, up to which the segment counts as
// straight and as equally near to a surface [-]. Larger: round bones penetrate deeper between particles.
// Smaller: on flat bones each segment has three contacts, whose shares of the load depend on rounding errors.
constexpr double kNoBulge = 1e-5;

struct BentSegment {
  Vec3 start, along;  // start; l [m]
  Vec3 bend[2];       // d_0 and d_1 [m]
  Vec3 bend_at(double u) const { return bend[u < 0.5 ? 0 : 1]; }
  // p(u) less the point of the chord [m].
  Vec3 bulge(double u) const { return (0.5 * (u - 0.5) * (u - 0.5)) * bend_at(u); }
  Vec3 at(double u) const { return start + u * along + bulge(u); }
  // Derivative of p(u) [m].
  Vec3 tangent(double u) const { return along + (u - 0.5) * bend_at(u); }
};

}  // namespace bt
