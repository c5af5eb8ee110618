// What the searches for what tendons touch of surfaces are made with (surface.h, near.h, primitive.h).
#pragma once
#include <cstddef>

namespace bt {

// Steps for which a plane is reused at most by a feature that has moved along it by more than this share of
// its distance [-]. More: what has come to rest leans on tilted planes for longer. Fewer: more queries.
constexpr int kOldest = 24;
constexpr double kFresh = 1e-2;

// Motion, as a share of its distance, for which a feature's nearest triangles are listed when it is measured
// [-], and how many at most; where there are more, it is for less. Larger: lists cost more. Smaller: more
// queries.
constexpr double kListed = 0.05;
constexpr size_t kMostNearby = 64;
// Distance, as a share of a surface's size, up to which rounding may hide that it is touched [-]: FCL is
// asked.
constexpr double kTouches = 1e-9;
// What a bound on a distance is enlarged by, so that what it was taken from is within it [-].
constexpr double kRoundedUp = 1e-9;
// Of closed forms (primitive.h): cosine between a segment and the way to it up to which it is parallel to the
// surface; rounding of a place, and what a distance has to exceed to be one, as shares of coordinates [-].
// Larger: what is slanted, or a little way off, is taken for flat, or touching. Smaller: rounding decides.
constexpr double kParallel = 1e-14;
constexpr double kLineRounding = 2e-16;
constexpr double kOnSurface = 1e-15;
// Steps and widths at which searches along a segment end [-]. Fewer, or wider: nearest points are off. More,
// or narrower: rounding is searched for.
constexpr int kRootSteps = 60;
constexpr double kRootWidth = 1e-15, kDeepestWidth = 1e-9;
constexpr double kGolden = 0.6180339887498949;
// Triangles in a leaf of a surface's tree [-].
constexpr int kLeafTriangles = 4;

}  // namespace bt
