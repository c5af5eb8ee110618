// The signed distance of a mesh on a regular grid of nodes, and its smooth interpolation.
//
// Between the nodes it is a tensor product of Catmull-Rom splines: its gradient is continuous, and linear
// functions are exact, so that a plane has its distance to rounding. Nodes are computed only in bricks of 8 x
// 8 x 8 cells that the surface is near to, or that lie behind it down to a depth. Of every brick, the
// distance at its centre bounds the distances in it.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "geometry/signed_distance.h"
#include "math/rotation.h"
#include "math/sym3.h"

namespace bt {

class DistanceGrid {
 public:
  struct Sample {
    double distance;
    Vec3 gradient;
  };
  // A point that may be behind the surface: its number and place.
  struct Behind {
    int point;
    Vec3 place;
    double distance;
    Vec3 gradient;
  };
  // spacing [m] of the nodes; depth [m] behind the surface to which the distance is known.
  DistanceGrid(const SignedDistance& distance, double spacing, double depth);
  // The same from stored values (numbers_of).
  explicit DistanceGrid(const std::vector<double>& numbers);
  // Number of nodes that the grid would have.
  static double nodes_of(const Box& box, double spacing);
  std::vector<double> numbers() const;

  // Tells grids apart.
  uint64_t mark() const { return mark_; }
  double spacing() const { return spacing_; }
  // A lower bound of the distance at x, for points within `radius` around it [m].
  double bound(Vec3 x, double radius) const;
  // The second derivatives of the interpolated distance at x [1/m]; they are not continuous where cells meet.
  // Only where `behind` finds a point.
  Sym3 curvature(Vec3 x) const;
  // Of the points that a rotation and a shift take to where they may be behind the surface.
  void behind(const Rot3& turn, Vec3 shift, const std::vector<Vec3>& points, std::vector<Behind>& out) const;
  // The distance near the surface; else a lower bound of it in front of the surface, and 0 beyond `depth`.
  double estimate(Vec3 x) const;

 private:
  void size(const Box& box);
  bool is_within(Vec3 cells) const;
  // Whether the point may be behind the surface; false at least where it is far from it.
  bool is_near(Vec3 x) const;
  double nearest(Vec3 cells) const;
  Sample interpolate(Vec3 x) const;
  size_t node(int i, int j, int k) const { return (static_cast<size_t>(k) * n_[1] + j) * n_[0] + i; }
  size_t brick(int i, int j, int k) const { return (static_cast<size_t>(k) * b_[1] + j) * b_[0] + i; }
  // Takes away jumps of the distance behind an open mesh.
  void limit_slope();
  void fill(const SignedDistance& distance, int i, int j, int k, int triangle);

  Vec3 origin_;  // of node (0, 0, 0)
  double spacing_ = 0, inverse_ = 0, depth_ = 0, slope_ = 1;
  std::array<int, 3> n_{}, b_{};   // nodes and bricks along each axis
  std::vector<double> values_;     // of nodes; infinity: not computed
  std::vector<double> of_bricks_;  // distance at the centre
  std::vector<char> known_;        // by brick: all its nodes are computed
  uint64_t mark_ = 0;
  void find_mark();
};

}  // namespace bt
