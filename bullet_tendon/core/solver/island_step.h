// One step of an island by the method of the options.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// One step by the method of the options; fills chain.next and the forces of holds and rows.
void solve(Group& group, const StepContext& context);

// Implicit, converged.
void converged_step(Group& group, const StepContext& context);

}  // namespace bt
