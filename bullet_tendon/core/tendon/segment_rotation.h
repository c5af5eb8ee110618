// Rotation of segments within a step, and the correction of their lengths for it.
#pragma once
#include "tendon/tendon.h"

namespace bt {

// Call it after tendon.dx was added to tendon.x_new. Removes the elongation of segments that is caused by
// their rotation alone (tendon/segment_rotation.cpp).
void keep_lengths(Tendon& c);

// Largest sine of the angle by which a segment rotates from tendon.x to the iterate tendon.x_new. A segment
// that is exactly reversed counts as not rotated.
double greatest_turn(const Tendon& c);

}  // namespace bt
