// The points at which an elastic foundation is integrated, and spheres around groups of them.
//
// Each point stands for a triangle, or for a patch of triangles that are close to each other and face the
// same way. It carries their area and lies at their centre of area. So a patch has the force of its
// triangles, and its moment, wherever the pressure is linear over it.
#pragma once
#include <vector>

#include "math/vec3.h"

namespace bt {

// Triangles, or what they are merged into, in the frame of their link.
struct FoundationSurface {
  std::vector<Vec3> centres;
  std::vector<double> areas;
  std::vector<int> regions;  // number of the connected patch
  int size() const { return static_cast<int>(centres.size()); }
};

// Merges triangles whose centres are within a box with sides of `resolution` at most [m], of one region, and
// whose unit normals differ by no more than a third. 0: as given.
FoundationSurface merged(const FoundationSurface& triangles, const std::vector<Vec3>& normals,
                         double resolution);

// Halves sets of points across their longest extent, down to a few, with a sphere around each set.
class SphereTree {
 public:
  SphereTree() = default;
  explicit SphereTree(const std::vector<Vec3>& points);
  // Number of each point as it was given, in the order of the tree.
  const std::vector<int>& order() const { return order_; }
  Vec3 centre() const { return nodes_.front().centre; }
  double radius() const { return nodes_.front().radius; }

  // Calls visit(i) for the points, by their order, of all sets that nothing above them lets be skipped:
  // skip(centre, radius).
  template <class Skip, class Visit>
  void each(Skip skip, Visit visit) const {
    for (size_t k = 0; k < nodes_.size();) {
      const Node& node = nodes_[k];
      if (skip(node.centre, node.radius)) {
        k = node.next;
        continue;
      }
      if (node.is_leaf)
        for (int i = node.first; i < node.first + node.count; ++i) visit(i);
      ++k;
    }
  }

 private:
  // In depth-first order: a set is followed by its halves.
  struct Node {
    int first, count;
    bool is_leaf;
    size_t next;  // the first that is no part of it
    Vec3 centre;
    double radius;
  };
  void add(const std::vector<Vec3>& points, int first, int count);

  std::vector<int> order_;
  std::vector<Node> nodes_;
};

}  // namespace bt
