// Exact signed distance from a point to a triangle mesh.
//
// The distance is negative behind the faces. The side is that of the angle-weighted pseudonormal of the face,
// edge or vertex with the nearest point (Baerentzen and Aanaes 2005), which is right for every closed mesh.
//
// An open mesh has no inside beyond its border. Where the nearest point p is on the border, with the
// pseudonormal m there and v = x - p,
//
//   m.v + |v - (m.v) m|
//
// takes the place of the distance: the surface goes on beyond its border and recedes at 45 degrees. This
// continues the distance without a jump, is positive in front of the surface and beside it, and its
// slope is at most the square root of two.
#pragma once
#include <array>
#include <vector>

#include "geometry/box_tree.h"

namespace bt {

class SignedDistance {
 public:
  using Indices = std::array<int, 3>;
  SignedDistance(std::vector<Vec3> vertices, std::vector<Indices> triangles);
  // triangle: one that is likely near, which then becomes the nearest one.
  double operator()(Vec3 x, int& triangle) const;
  double operator()(Vec3 x) const;
  bool open() const { return open_; }
  // Around the mesh, and around what is behind an open one down to a depth [m].
  Box box(double depth) const;
  // Volume behind the faces of a closed mesh [m^3].
  double volume() const;

 private:
  // Pseudonormals of a triangle's features: face; edges opposite to the corners; corners. And which edges and
  // corners are on the border.
  struct Features {
    Vec3 face, edge[3], corner[3];
    bool edge_open[3], corner_open[3];
  };
  // A nearest point and its feature: 0 the face, 1 to 3 the edge opposite to a corner, 4 to 6 a corner.
  struct Found {
    double square, reach;  // squared distance, and the distance beyond which nothing is nearer [m]
    Vec3 point;
    int triangle, feature;
  };
  void find_features();
  void measure(int triangle, Vec3 x, Found& best) const;

  std::vector<Vec3> vertices_;
  std::vector<Indices> triangles_;
  std::vector<Features> features_;
  BoxTree tree_;  // of the triangles
  bool open_ = false;
};

}  // namespace bt
