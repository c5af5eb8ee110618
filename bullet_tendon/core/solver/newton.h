// Newton's method on one island.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// Solves the implicit step of the island by Newton's method. tendon.x_new is the starting guess, and then the
// result.
void newton(Island& island, const StepContext& context);

}  // namespace bt
