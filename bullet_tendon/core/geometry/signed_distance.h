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

#include "geometry/bounds.h"
#include "math/simd.h"

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
  // Of a binary tree in order of depth first: the first child is the next node. Its triangles are between two
  // planes, at low <= n.x <= high. A leaf has the triangles of one group.
  struct Node {
    Box box;
    Vec3 normal;
    double low = 0, high = 0;  // [m]
    int group = -1;            // -1: not a leaf
    int second = -1;           // its other child
  };
  // Eight triangles side by side: a corner, and the edges from there to the two others.
  struct Group {
    Eight corner[3], one[3], other[3];
  };
  // Pseudonormals of a triangle's features: face; edges opposite to the corners; corners. And which edges and
  // corners are on the border.
  struct Features {
    Vec3 face, edge[3], corner[3];
    bool edge_open[3], corner_open[3];
  };
  // A nearest point and its feature: 0 the face, 1 to 3 the edge opposite to a corner, 4 to 6 a corner.
  struct Found {
    double square;
    Vec3 point;
    int triangle, feature;
  };
  int build(int first, int count);
  void fill_groups();
  void find_features();
  void measure(int triangle, Vec3 x, Found& best) const;
  static double square_to(const Node& node, Vec3 x);
  friend void squares_to(const Group& group, Vec3 x, Eight& squares);
  friend void search(const SignedDistance& mesh, Vec3 x, Found& best);

  std::vector<Vec3> vertices_;
  std::vector<Indices> triangles_;
  std::vector<Features> features_;
  std::vector<Node> nodes_;
  std::vector<Group> groups_;
  bool open_ = false;
};

}  // namespace bt
