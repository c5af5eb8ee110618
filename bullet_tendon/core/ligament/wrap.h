// A surface of a link that the path of a ligament wraps around: a sphere, a cylinder without ends, or an
// ellipsoid.
//
// Between two points outside, the shortest way around it is straight to a point of the surface, along a
// geodesic, and straight again. Without friction the tension is the same everywhere, and the gradient of the
// length by the places of points and surface is that of the two straight parts: the points of the surface
// are where the length is least, so that their change adds nothing. Around a sphere the geodesic is an arc of
// a great circle in the plane of both points and the centre. Around a cylinder it is a helix: the way across
// the axis is that around a circle, and the way along the axis is in proportion to it. Around an ellipsoid it
// is found by Newton's method (ligament/geodesic.h).
//
// Where the straight line between the points begins to touch, the arc has no length: the length of the path
// and its gradient are continuous there. Of two ways around, the shorter one is taken.
#pragma once
#include <vector>

#include "ligament/geodesic.h"
#include "math/rotation.h"

namespace bt {

enum class WrapShape { sphere, cylinder, ellipsoid };

// What does not change of it. A wrap belongs to the ligaments that were made with it, and holds nothing that
// a step changes.
struct Wrap {
  int link = -1;  // slot
  WrapShape shape = WrapShape::sphere;
  Pose local;  // its frame, in that of the link; the axis of a cylinder is z
  Vec3 radii;  // semi-axes [m]; that of a cylinder along z does not count
};

// The way around, in the world or whichever axes the points are in: where it meets and leaves the surface,
// and the length between [m].
struct Wrapped {
  bool touches = false;
  Vec3 first, last;
  double arc = 0;
};

// From p to q, with the frame of the wrap in the same axes. It does not touch where the straight line passes
// by, or where an end is inside. near: the geodesic of a way nearby around an ellipsoid, in the frame of the
// wrap; it becomes that of this way.
Wrapped wrap_around(const Wrap& wrap, const Pose& frame, Vec3 p, Vec3 q, Geodesic& near);

// By how much the second derivatives of the length of the way around differ from those of its two straight
// parts with their points of contact fixed. With the unit vectors a and b, and the motions u of p and v of q
// relative to the wrap, the difference is first (a.u)^2 + 2 shared (a.u) (b.v) + last (b.v)^2 [1/m]. It is
// zero around an ellipsoid, where it is not known, and where the wrap is not in the way.
struct WrapCurvature {
  Vec3 a, b;
  double first = 0, shared = 0, last = 0;
};
WrapCurvature curvature_around(const Wrap& wrap, const Pose& frame, Vec3 p, Vec3 q);

// Appends kTraced points of the way from p to q around the first of the wraps that is in its way, q included.
// The wraps' frames are in the axes of the points.
constexpr int kTraced = 18;
void trace(const std::vector<Wrap>& wraps, Vec3 p, Vec3 q, std::vector<Vec3>& points);

}  // namespace bt
