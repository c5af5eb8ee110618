// What the searches for what tendons may touch are made with: of each other (search.h), and of the triangles
// of surfaces (surface.h, near.h).
#pragma once
#include <cstddef>

namespace bt {

// Segments in a leaf of a tendon's tree [-].
constexpr int kLeafSegments = 4;

// Of tendons that are apart, the share of the room between them that a search makes sure of; the most room
// that it looks for, the least that it takes for one, and what it lists the segments in where there is less,
// in sums of radii [-]. More: searches take longer. Less: they are made more often.
constexpr double kRoomKept = 0.7;
constexpr double kMostRoom = 16.0;
constexpr double kLeastRoom = 0.1;
constexpr double kListedRoom = 0.35;
// Looks that a search has to last for, or boxes are compared for the next ones, at most so many [-]. More:
// what slows down is searched late. Fewer: what is fast is searched for nothing.
constexpr int kLooksWorth = 8;
constexpr int kLongestWait = 256;
// Growth of a front from which on it is made anew [-]. More: it is divided where it need not be. Less: it is
// made for nothing.
constexpr double kMostGrown = 2.0;
// What particles are off the motion of their tendon, in radii, from which on a search measures that anew [-].
// Larger: searches leave less room. Smaller: the others' grows less.
constexpr double kSettled = 0.05;

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
