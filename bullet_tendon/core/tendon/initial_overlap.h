#pragma once

namespace bt {

// Two segments of one tendon can touch only if the arc length between them exceeds this many radii [-]. A
// tendon in the tightest possible bend (radius of the centreline = radius of the tendon) touches itself
// after half a turn. Smaller: neighbours push each other apart in every bend.
constexpr double kSelfContactArc = 3.14159265358979;

}  // namespace bt
