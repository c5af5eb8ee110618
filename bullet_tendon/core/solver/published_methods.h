// The methods of the paper.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

void single_linearisation(Island& island, const StepContext& context);  // one linearisation of implicit Euler
void explicit_euler(Island& island, const StepContext& context);

}  // namespace bt
