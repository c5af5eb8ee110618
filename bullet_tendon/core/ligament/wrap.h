// A surface of a link that the path of a ligament wraps around: a sphere, or a cylinder without ends.
//
// Between two points outside, the shortest way around it is straight to a point of the surface, along a
// geodesic, and straight again. Without friction the tension is the same everywhere, and the gradient of the
// length by the places of points and surface is that of the two straight parts: the points of the surface
// are where the length is least, so that their change adds nothing. Around a sphere the geodesic is an arc of
// a great circle in the plane of both points and the centre. Around a cylinder it is a helix: the way across
// the axis is that around a circle, and the way along the axis is in proportion to it.
//
// Where the straight line between the points begins to touch, the arc has no length: the length of the path
// and its gradient are continuous there. Of two ways around, the shorter one is taken.
#pragma once
#include "math/rotation.h"

namespace bt {

enum class WrapShape { sphere, cylinder };

// What does not change of it. A wrap belongs to the ligaments that were made with it, and holds nothing that
// a step changes.
struct Wrap {
  int link = -1;  // slot
  WrapShape shape = WrapShape::sphere;
  Pose local;         // its frame in that of the link; the axis of a cylinder is z
  double radius = 0;  // [m]
};

// The way around, in the world or whichever axes the points are in: where it meets and leaves the surface,
// and the length between [m].
struct Wrapped {
  bool touches = false;
  Vec3 first, last;
  double arc = 0;
};

// From p to q, with the frame of the wrap in the same axes. It does not touch where the straight line passes
// by, or where an end is inside.
Wrapped wrap_around(const Wrap& wrap, const Pose& frame, Vec3 p, Vec3 q);

}  // namespace bt
