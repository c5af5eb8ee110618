// Pulls that give segments their lengths (pulls.cpp), and what they move.
#pragma once
#include "stepping.h"

namespace bt {

// Work space, by segment but for w.
struct Pulls {
  // too_long: by so much; along: cosine with the segment before.
  double *w, *tau, *above, *too_long, *length, *along;
  Field &u, &unbalanced;
  explicit Pulls(Chain& c)
      : w(c.cg_remainder[0]),
        tau(c.cg_remainder[1]),
        above(c.cg_remainder[2]),
        too_long(c.cg_image[0]),
        length(c.cg_image[1]),
        along(c.cg_image[2]),
        u(c.cg_direction),
        unbalanced(c.cg_preconditioned) {}
};

// b^2/mass of the particles, 0 of what is held.
void weigh(const Chain& c, Pulls& p);
// The guess in chain.next, with the lengths that segments had when they were last measured.
void keep_present(Chain& c, Pulls& p);

}  // namespace bt
