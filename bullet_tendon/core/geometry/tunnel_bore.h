// Algorithm 2: a tendon in bone tunnels. Closed forms, no distance queries.
#pragma once
#include <algorithm>
#include <cmath>

#include "geometry/bent_segment.h"
#include "geometry/bounds.h"
#include "math/rotation.h"

namespace bt {

// Length beyond each mouth, in radii, over which a bore removes bone surface [-]. It is enough for bores at
// up to 63 degrees from the surface normal: no surface remains across the mouth.
constexpr double kBoreReach = 2.0;

// Where the wall of a bore meets the surface of the bone, which is a plane there: an ellipse, and a circle
// where the plane is across the axis. Its points are c + R d + (slope.R d) e, for all unit vectors d across
// the axis e.
struct Rim {
  Vec3 centre, axis;     // c [m]; e, unit vector
  double radius = 0;     // R, the shorter semi-axis [m]
  Vec3 slope;            // across the axis: rise of the plane along the axis, per length across it [-]
  double longest = 0;    // the longer semi-axis [m]
  Vec3 longer, shorter;  // unit vectors along the semi-axes, if the slope is not zero
  int half = 0;          // 1, -1: only the half on that side of the longer axis; 0: all of it
  double end_c = 1,
         end_s = 0;  // where a half ends, as the place of a RimPoint; it goes on straight there [-]
  bool is_circle() const { return longest == radius; }
  // Height of a point over the plane of the rim [m].
  double height(Vec3 p) const { return dot(p - centre, axis - slope) * radius / longest; }
};

Rim rim_of(Vec3 centre, Vec3 axis, double radius, Vec3 slope);
// The rim after a rotation about its centre.
Rim turned(Rim rim, const Rot3& by);

// Ends both halves of an ellipse where they are nearest to a line that goes along a direction between them,
// at this distance from both [m]: such a line keeps it from the rest of them.
void end_halves(Rim& rim, double distance, Vec3 along);

// A point of a rim, with the unit tangent and the curvature vector of the rim there [1/m].
struct RimPoint {
  Vec3 point, tangent, curvature;
  double c = 0, s = 0;  // its place along the longer and the shorter semi-axis, without signs, over these [-]
};

// A bore in a link: a cylinder between two planes (link frame), with rims that are sharp or rounded by a
// chamfer radius.
struct Tunnel {
  int link = 0;
  Vec3 start, end;              // where its axis meets the planes of its mouths, in the link's frame [m]
  double radius = 0;            // [m]
  double chamfer = 0;           // radius of the rounded edges of the mouths [m]; 0: sharp
  double friction = 0;          // coefficient; negative: that of the link [-]
  Vec3 start_slope, end_slope;  // of both planes, see Rim [-]
};

// The bore in the world, at the start of a step.
struct Bore {
  Vec3 start, axis;    // centre of the first mouth [m]; unit vector towards the other mouth
  double length = 0;   // along the axis [m]
  double radius = 0;   // [m]
  double chamfer = 0;  // [m]
  Vec3 slope[2];       // of the mouths' planes, see Rim [-]
  Box box;             // around it, its chamfers included [m]
  int tunnel = -1;     // slot
  // Coordinate of p along the axis, from the start [m].
  double along(Vec3 p) const { return dot(p - start, axis); }
  // Distance of p from the axis [m].
  double off_axis(Vec3 p) const { return norm(without(p - start, axis)); }
  // How far p is beyond the plane of a mouth, along the axis; negative: before it [m].
  double beyond(int mouth, Vec3 p) const {
    const double z = along(p), rise = dot(slope[mouth], p - start);
    return mouth ? z - length - rise : rise - z;
  }
  double beyond(Vec3 p) const { return std::max(beyond(0, p), beyond(1, p)); }
  // Within the bore, lengthened by `more` at both mouths.
  bool contains(Vec3 p, double more) const { return beyond(p) <= more && off_axis(p) <= radius; }
  // Coordinate along the axis of p, or of the mouth's plane that p is beyond [m].
  double along_within(Vec3 p) const {
    return std::min(std::max(along(p), dot(slope[0], p - start)), length + dot(slope[1], p - start));
  }
  // Coordinate along the axis at which the chamfer of a mouth begins, on the axis [m].
  double chamfer_at(int mouth) const {
    const double depth = chamfer * std::sqrt(1 + dot(slope[mouth], slope[mouth]));
    return mouth ? length - depth : depth;
  }
  // Whether there is no bone at p because of the bore, or of the chamfer of a mouth.
  bool removes(Vec3 p) const {
    const double wide = has_wall(p, along(p)) ? radius : radius + chamfer;
    return beyond(p) <= kBoreReach * wide && off_axis(p) <= wide;
  }
  // Whether the wall nearest to p, at z along the axis, is there: neither open nor a chamfer.
  bool has_wall(Vec3 p, double z) const;
  // Whether p is between both rims, nearer to neither mouth than any point of its rim.
  bool is_within_rims(Vec3 p) const;
  // Whether the mouths' planes are between the ends of segment a-b, and whether it passes both in the bore.
  bool is_between(Vec3 a, Vec3 b) const;
  bool is_threaded(Vec3 a, Vec3 b) const;
  // Share of segment a-b, whose start is inside, up to where it leaves the bore [-].
  double leaves(Vec3 a, Vec3 b) const;
  // The edge of a mouth, around which its contacts keep the tendon's radius and that of the chamfer.
  Rim rim(int mouth) const;
};

// The bore of a link at this pose.
Bore in_world(const Tunnel& tunnel, const Pose& pose);

// The point of a rim nearest to p; of a point on the axis of a circle, any of them. The search starts at
// `last`, if that was found before.
RimPoint nearest_on_rim(const Rim& rim, Vec3 p, const RimPoint& last = {});
// Parameter in [0, 1] of the point of a segment next to u from which the rim is nowhere nearer. at: the point
// of the rim that was found last.
double slide_to_rim(const BentSegment& segment, double u, const Rim& rim, RimPoint& at);
// Whether segment a-b passes through the plane of the rim outside of it.
bool passes_beyond(const Rim& rim, Vec3 a, Vec3 b);
// Parameter in [0, 1] of the point of a segment nearest to the rim.
double nearest_to_rim(const BentSegment& segment, const Rim& rim);

}  // namespace bt
