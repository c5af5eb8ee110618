// Second contact points of pairs, found in the solution.
#pragma once
#include "solver/island.h"

namespace bt {

// Contacts that the solution leaves nearer than their contacts meant, because their nearest points have
// moved along, get one more contact each beside the first (which holds what it held). true: some did.
bool add_missed(Island& island);

}  // namespace bt
