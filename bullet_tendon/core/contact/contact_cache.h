// What contacts remember from one step to the next, and how they are told apart.
#pragma once
#include "contact/contact.h"

namespace bt {

// What a contact remembers from one step to the next.
struct ContactMemory {
  ContactKey key;
  double lambda = 0;            // N [N]
  double lambda_confirmed = 0;  // the least of the last two [N]
  bool sliding = false;
  Vec3 mean_force;
  double h_eff = 0;     // step weight of the tendon [s]
  Vec3 tangent_anchor;  // in the link's frame, or the world's for two tendons
};

}  // namespace bt
