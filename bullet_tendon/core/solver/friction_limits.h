// Friction limits that change within the linear solution.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// Corrects tendon.dx for friction limits that change with the normal forces of the step. Changes below a
// small share of `enough` [N] are neglected.
void solve_limits(Island& island, const StepContext& context, double enough);

}  // namespace bt
