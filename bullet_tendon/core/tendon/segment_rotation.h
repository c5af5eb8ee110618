// How far segments rotate in a step, and what that makes of their lengths.
#pragma once
#include "tendon/tendon.h"

namespace bt {

// After tendon.dx was added to tendon.x_new: without what segments got longer by turning
// (tendon/segment_rotation.cpp).
void keep_lengths(Tendon& c);

// Greatest sine of the angle by which a segment turns from tendon.x to the guess in tendon.x_new; what is
// turned over along itself does not count.
double greatest_turn(const Tendon& c);

}  // namespace bt
