// Friction limits that go with the step.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// How well limits are solved for beside the step [-], and by how many solutions at most
// (solver/friction_limits.cpp). Looser, or fewer: more iterations, each with a factorisation. More: solutions
// for what the next iteration changes.
constexpr double kLimitAccuracy = 0.03;

// What friction limits that go with the step make of tendon.dx, where they change by more than `enough` [N]
// (solver/friction_limits.cpp).
void solve_limits(Island& island, const StepContext& context, double enough);

}  // namespace bt
