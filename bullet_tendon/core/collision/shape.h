// Collision shapes of links, and the bores in them.
#pragma once
#include <memory>

#include "bodies/link.h"
#include "geometry/primitive_distance.h"
#include "geometry/signed_distance.h"
#include "geometry/triangle_bvh.h"
#include "geometry/tunnel_bore.h"

namespace bt {

struct Shape {
  int link = 0;
  Pose local;   // of the shape's frame, in the link's frame
  Vec3 lo, hi;  // bounding box, shape frame [m]
  bool half_space = false;
  Vec3 plane_normal;                       // half-space: its surface is n.x = plane_offset, shape frame
  double plane_offset = 0;                 // [m]
  double friction = 0;                     // coefficient; negative: that of the link (Link::friction_of) [-]
  std::shared_ptr<const Surface> surface;  // mesh; else null
  std::shared_ptr<const SignedDistance> solid;  // of a mesh that encloses something; else null
  Primitive primitive;                          // closed form; else of kind none
  Box box() const { return {lo, hi}; }
};

Pose in_world(const Shape& shape, const Link& link);

}  // namespace bt
