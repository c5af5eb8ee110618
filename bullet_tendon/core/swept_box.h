// The box around where a segment is and, as foreseen, will be at the end of the step, relative to its
// tendon's mean motion, grown by skin and slack.
#pragma once
#include "box.h"
#include "chain.h"

namespace bt {

Box swept_box(const Chain& c, int segment, Vec3 mean_motion, double skin);

}  // namespace bt
