// The paper's methods: one linearisation, and explicit Euler.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

void single_linearisation(Island& island, const StepContext& context);  // implicit, as published
void explicit_euler(Island& island, const StepContext& context);

}  // namespace bt
