// Unilateral constraints of a body: joint limits and contacts (bodies/unilateral_stops.cpp).
#pragma once

namespace bt {

// A limit that is reached, or a contact. In this step it may bound the rate along a direction d from below.
struct Stop {
  double wanted = 0;     // lower bound of the rate [m/s], [rad/s]
  double missing = 0;    // `wanted` less the rate predicted without stops and without tendons
  double held_back = 0;  // `wanted` less the rate predicted without stops, but with the tendons
  int coordinate = -1;   // of a limit; -1: a contact
  bool acts = false;
};

}  // namespace bt
