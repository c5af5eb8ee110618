// What a tendon can touch: shapes of links, and the bores in them.
#pragma once
#include <memory>

#include "bodies/link.h"
#include "geometry/primitive_distance.h"
#include "geometry/triangle_bvh.h"
#include "geometry/tunnel_bore.h"

namespace bt {

struct Shape {
  int link = 0;
  Pose local;   // of the shape's frame in the link's frame
  Vec3 lo, hi;  // box around it in its own frame
  bool half_space = false;
  Vec3 plane_normal;  // of a half-space: n.x = offset is the surface
  double plane_offset = 0;
  double friction = 0;
  std::shared_ptr<const Surface> surface;  // of a mesh
  Primitive primitive;                     // of a closed form
};

Pose in_world(const Shape& shape, const Link& link);

Bore in_world(const Tunnel& t, const Link& link);

}  // namespace bt
