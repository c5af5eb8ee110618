// What a bore leaves of the triangles of a bone.
#pragma once
#include <memory>
#include <vector>

#include "geometry/triangle_bvh.h"
#include "geometry/tunnel_bore.h"

namespace bt {

// What the tunnels of these slots leave of a mesh.
struct DrilledMesh {
  std::vector<int> tunnels;
  std::unique_ptr<const Surface> left;
};

// The triangles without what the bore removes (Bore::removes), and without the surface beside the edges of
// its mouths, which have contacts of their own. Those across its wall are cut there; the bore is in the frame
// of the triangles. Its wall is a prism of flat facets around the round one: what is left begins up to 0.1 %
// of the radius beyond the wall.
std::vector<Triangle> drilled(const std::vector<Triangle>& triangles, const Bore& bore);

}  // namespace bt
