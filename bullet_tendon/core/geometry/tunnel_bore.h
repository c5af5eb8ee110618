// Algorithm 2: a tendon in bone tunnels. Closed forms, no distance queries.
#pragma once
#include "geometry/bounds.h"

namespace bt {

// A bore in a link: a cylinder from start to end (link frame) whose two mouths are circles, sharp
// or rounded by a chamfer radius.
struct Tunnel {
  int link = 0;
  Vec3 start, end;      // centres of the mouths, in the link's frame [m]
  double radius = 0;    // [m]
  double chamfer = 0;   // radius of the rounded edges of the mouths [m]; 0: sharp
  double friction = 0;  // coefficient [-]
};

// The bore in the world, at the start of a step.
struct Bore {
  Vec3 start, axis;    // centre of the first mouth [m]; unit vector towards the other mouth
  double length = 0;   // [m]
  double radius = 0;   // [m]
  double chamfer = 0;  // [m]
  Box box;             // around it, its chamfers included [m]
  // Coordinate of p along the axis, from the start [m].
  double along(Vec3 p) const { return dot(p - start, axis); }
  // Distance of p from the axis [m].
  double off_axis(Vec3 p) const { return norm(without(p - start, axis)); }
  // Within the bore, lengthened by `beyond` at both mouths.
  bool contains(Vec3 p, double beyond) const {
    double z = along(p);
    return z >= -beyond && z <= length + beyond && off_axis(p) <= radius;
  }
  // Share of segment a-b, whose start is inside, up to where it leaves the bore [-].
  double leaves(Vec3 a, Vec3 b) const;
};

// The point of the circle (centre, axis, radius) nearest to p.
Vec3 nearest_on_circle(Vec3 p, Vec3 centre, Vec3 axis, double radius, Vec3 fallback);
// Parameter in [0, 1] of the point of segment a-b nearest to the circle.
double nearest_to_circle(Vec3 a, Vec3 b, Vec3 centre, Vec3 axis, double radius);

}  // namespace bt
