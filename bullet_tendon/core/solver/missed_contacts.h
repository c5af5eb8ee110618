// Second contact points of pairs, found in the solution.
#pragma once
#include "solver/island.h"

namespace bt {

// Contacts that the solution leaves nearer than their rows meant, because their nearest points have
// moved along, get one more row each beside the first (which holds what it held). true: some did.
bool add_missed(Group& group);

}  // namespace bt
