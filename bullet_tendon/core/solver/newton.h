// Newton's method on one island.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// One Newton solution, from the guess in tendon.x_new to tendon.x_new.
void newton(Island& island, const StepContext& context);

}  // namespace bt
