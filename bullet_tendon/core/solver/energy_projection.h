// Removal of the energy that a solution creates.
#pragma once
#include "solver/island.h"

namespace bt {

// Removes the energy that a step of implicit Euler created from tendon.v_new.
void project_energy(Island& island, Vec3 gravity);

}  // namespace bt
