// Friction limits that go with the step.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// Corrects tendon.dx for friction limits that change with the normal forces of the step. Changes of less than
// a small share of `enough` [N] are left out (solver/friction_limits.cpp).
void solve_limits(Island& island, const StepContext& context, double enough);

}  // namespace bt
