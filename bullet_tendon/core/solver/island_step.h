// One step of an island by the method of the options.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// One step by the method of the options; fills tendon.x_new and the forces of holds and contacts.
void solve(Island& island, const StepContext& context);

// Implicit, converged.
void converged_step(Island& island, const StepContext& context);

}  // namespace bt
