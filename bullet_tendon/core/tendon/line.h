// A line between a particle and a point of a link, as hardware that fixes a graft to a bone is.
//
// Its tension is T = min(F, k (l - l_0 - s)), with its length l, its first length l_0, and the slip s. That
// is a return map, as that of friction: where k (l - l_0 - s) is above F at the end of a substep, s grows
// until it is F. A device that pulls is a line with l_0 = 0 that does not slip for good: it pulls by F, down
// to the length F/k. There the particle has come to its point, and has to be held there by less than F: a
// force F towards a point has no direction at that point. The particle of a line is free: a line adds no
// unknowns (solver/body_schur.cpp).
#pragma once
#include <algorithm>
#include <cmath>

#include "math/sym3.h"

namespace bt {

struct Line {
  double spring = 0;      // k [N/m]
  double rest = 0;        // l_0 [m]; 0: of a device that pulls
  double slip = 0;        // s [m]
  double most_force = 0;  // F [N]
  double load = 0;        // F in this substep, unbounded where no line slips [N]
  bool slips = false;     // it slips in the linearisation
  Vec3 end;               // its point on the link at the iterate [m]
  // In the last evaluation: from its point to the particle, unit vector; l [m]; k (l - l_0 - s), and T [N].
  Vec3 along;
  double length = 0, elastic = 0, tension = 0;

  // Begins a substep in which its point is predicted at `at`. stays: it does not slip, unless it is a device.
  void begin(Vec3 at, bool stays) {
    end = at;
    stays &= rest > 0;
    load = stays ? HUGE_VAL : most_force;
    slips &= !stays;
  }
  // Evaluates it with its particle at x. Returns its force on the link [N].
  Vec3 stretch(Vec3 x) {
    const Vec3 d = x - end;
    length = norm(d);
    along = unit_or(d, along);
    elastic = spring * (length - rest - slip);
    tension = std::min(elastic, load);
    return tension * along;
  }
  bool is_beyond() const { return elastic > load; }
  // Decides whether the next linearisation slips, from the displacement of the particle relative to the point
  // that a linear solution predicts.
  void predict(Vec3 moved) { slips = elastic + spring * dot(along, moved) > load; }
  // The force of the linearisation at the last evaluation [N], and its block [N/m]. Of a line that pushes,
  // the turning is left out, so that the block is not indefinite.
  Vec3 linearised() const { return (slips ? load : elastic) * along; }
  Sym3 block() const {
    const double turning = length > 0 ? std::max(0.0, slips ? load : elastic) / length : 0;
    return (slips ? 0 : spring) * outer(along) + turning * across(along);
  }
  // Potential of its force at the last evaluation [J].
  double potential() const {
    if (spring == 0) return 0;
    const double beyond = std::max(0.0, elastic - load);
    return 0.5 * (elastic * elastic - beyond * beyond) / spring;
  }
  // Lets it slip by what is beyond its load.
  void let_slip() {
    if (rest > 0 && is_beyond()) slip += (elastic - load) / spring;
  }
};

}  // namespace bt
