// One step of an island by the method of the options.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// One substep by the method of the options. Computes tendon.x_new, tendon.v_new and the forces of anchors and
// contacts.
void solve(Island& island, const StepContext& context);

// The implicit method, solved by Newton's method (solver/newton.cpp).
void converged_step(Island& island, const StepContext& context);

}  // namespace bt
