// One term of a step's potential by itself, at any state: what derivatives are tested with.
#pragma once
#include "row.h"

namespace bt {

struct Term {
  double energy = 0;           // [J], elastic: damping has none of its own
  Field gradient;              // what it adds to the residual [N]
  std::vector<double> matrix;  // 3n x 3n, row-major, coordinates of a particle together [N/m]
};

// Structure or shear springs at x, `before` one step of weight b [s] earlier, with the plain Newton
// linearisation and nothing cut off.
Term spring_term(const Chain& c, bool shear, const Field& x, const Field& before, double b);
// Bending and clamps at x, nothing cut off.
Term bending_term(const Chain& c, const Field& x);

}  // namespace bt
