// Newton's method on one island.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// One Newton solution at tendon.x_new; the safeguard is used only if asked for.
void newton(Island& island, const StepContext& context, bool safeguarded);

}  // namespace bt
