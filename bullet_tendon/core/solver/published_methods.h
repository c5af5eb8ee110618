// The paper's methods: one linearisation, and explicit Euler.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

void single_linearisation(Group& group, const StepContext& context);  // implicit, as published
void explicit_euler(Group& group, const StepContext& context);

}  // namespace bt
