#pragma once

namespace bt {

// Two segments of one tendon can touch when the arc between them exceeds this many radii [-]: a
// tendon bent as tightly as a tube can (centreline radius = tendon radius) touches itself after
// half a turn. Smaller: neighbours push each other apart in every bend.
constexpr double kSelfContactArc = 3.14159265358979;

}  // namespace bt
