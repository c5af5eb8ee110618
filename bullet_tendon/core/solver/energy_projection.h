// Energy that a solution made out of nothing is taken from its velocities.
#pragma once
#include "solver/island.h"

namespace bt {

// Takes energy that a solution made out of nothing from its velocities.
void project_energy(Island& island);

}  // namespace bt
