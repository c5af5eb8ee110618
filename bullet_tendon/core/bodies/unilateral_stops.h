// Limits and contacts that push in one direction only (unilateral_stops.cpp).
#pragma once

namespace bt {

// What may stop the rate along a direction d in this step, from below: a limit that is reached, or a contact.
struct Stop {
  double wanted = 0;     // rate that it gives
  double missing = 0;    // of that, to the rate foreseen without it and without the tendons
  double held_back = 0;  // and with them
  int coordinate = -1;   // of a limit; -1: a contact
  bool acts = false;
};

}  // namespace bt
