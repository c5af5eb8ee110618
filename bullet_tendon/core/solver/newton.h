// Newton's method on one island.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// One Newton solution at chain.next; the safeguard is used only if asked for.
void newton(Group& group, const StepContext& context, bool safeguarded);

}  // namespace bt
