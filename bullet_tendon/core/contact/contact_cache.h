// State of contacts that is kept from step to step.
#pragma once
#include "contact/contact.h"

namespace bt {

// The kept state of one contact.
struct ContactMemory {
  ContactKey key;
  double lambda = 0;            // N [N]
  double lambda_confirmed = 0;  // the smaller N of the last two steps [N]
  double load = 0;              // the same, if no gap or depth remained that is too large; else 0 [N]
  double squeezed_gap = 0;      // gap of one that bears by the tendon's cross-section; 0: it does not [m]
  bool sliding = false;
  Vec3 mean_force;   // on the point a [N]
  Vec3 given_force;  // ContactForce::given [N]
  double h_eff = 0;  // step weight of the tendon [s]
  // In the link's frame; in the world frame for two tendons.
  Vec3 tangent_anchor;  // xi [m]
  Vec3 normal;          // n
};

}  // namespace bt
