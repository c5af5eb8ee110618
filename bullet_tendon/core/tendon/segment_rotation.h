// How far segments rotate in a step.
#pragma once
#include "tendon/tendon.h"

namespace bt {

// Greatest sine of the angle by which a segment turns from tendon.x to the guess in tendon.x_new. A segment
// that is turned over along itself does not count.
double greatest_turn(const Tendon& c);

}  // namespace bt
