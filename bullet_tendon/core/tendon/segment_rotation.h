// How far segments rotate in a step, and what that makes of their lengths.
#pragma once
#include "tendon/tendon.h"

namespace bt {

// After chain.step was added to chain.next: without what segments got longer by turning
// (tendon/segment_rotation.cpp).
void keep_lengths(Chain& c);

// Greatest sine of the angle by which a segment turns from chain.x to the guess in chain.next; what is turned
// over along itself does not count.
double greatest_turn(const Chain& c);

}  // namespace bt
