// Cartilage between two links: an elastic foundation.
//
// The layer of both surfaces is a bed of springs that do not act on each other. A point of surface B that
// stands for the area A (cartilage/foundation.h), at the signed distance -d < 0 from surface A, is pressed
// out along the gradient n of the distance by the force p A n with the pressure
//
//   p = K d,   K = E (1 - nu)/((1 + nu)(1 - 2 nu))/thickness,
//
// of a thin elastic layer on a rigid base that cannot bulge sideways (Bei and Fregly 2004), or that of a
// layer that cannot be pressed flat (FoundationLaw). A damped layer has p (1 + c dd/dt), at least 0, with
// dd/dt the change of d in the substep over its length (Hunt and Crossley 1975). Within a substep p is a
// function of d alone, with the potential sum A int p dd.
//
// All sums over points are made in the frame of A, about its origin. The relative motion of the point x
// there along n is n.v + (x x n).w for the relative twist v, w. So one wrench and one matrix of 6 x 6,
//
//   sum p A (n, x x n),      sum A dp/dd (n, x x n) (n, x x n)^T      (Gauss-Newton),
//
// give those of both links by a change of the point of reference. What the second derivative of the distance
// and the rotation of its gradient with A add, of the order of p A over the radius of curvature, is left out
// there (add_curvature).
//
// Which points may be behind A is searched for with a margin. That list is served until B has moved by the
// margin relative to A.
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "cartilage/distance_grid.h"
#include "cartilage/foundation.h"
#include "element/element.h"

namespace bt {

struct CartilageModel {
  FoundationLaw law;
  double damping = 0;  // c [s/m]
};

// What presses on a connected patch of B. World axes and origin.
struct PressedRegion {
  Vec3 force, torque;       // on B, about the centre of mass of its link [N], [N m]
  double area = 0;          // of the pressed triangles [m^2]
  Vec3 centre;              // of pressure [m]; zero where nothing is pressed
  double max_pressure = 0;  // [Pa]
  double max_depth = 0;     // [m]
};

struct CartilageState {
  std::vector<PressedRegion> regions;
};

class Cartilage : public Element, public CartilageState {
 public:
  // triangles: of B; points: at which the foundation is integrated.
  Cartilage(int link_a, std::shared_ptr<const DistanceGrid> grid, int link_b, FoundationSurface triangles,
            const FoundationSurface& points, const CartilageModel& model);
  int link_a() const { return link_a_; }
  int link_b() const { return link_b_; }
  const CartilageModel& model() const { return model_; }
  const FoundationSurface& points() const { return points_; }
  // Depths of all triangles where the links are now, in the order in which they were given [m]. Negative: a
  // lower bound of the distance to A.
  std::vector<double> depths(const std::vector<Link>& links) const;
  // Of the triangles that may be behind A where the links are now: their number, and the cosine between their
  // normals and the gradient of the distance. normals: of all triangles.
  std::vector<std::pair<int, double>> facing(const std::vector<Link>& links,
                                             const std::vector<Vec3>& normals) const;
  // Largest motion of points of B relative to A, of those that may reach A in it, where the links move by
  // these displacements and rotations [m]; or a bound of it, where that is at most `enough`.
  double motion(const std::vector<Link>& links, const Twist& of_a, const Twist& of_b, double enough) const;
  // Tells surfaces apart.
  uint64_t mark() const;
  // Depth beyond the thickness at the end of a substep [m], and whether it was reported: once.
  struct Flattening {
    double depth = 0;
    bool reported = false;
  };
  Flattening flattening;

  void begin(const std::vector<Link>& links, double h) override;
  void evaluate(const std::vector<LinkEnd>& ends) override;
  void add_stiffness(std::vector<LinkPair>& pairs, bool definite) const override;
  // - sum p A J^T (d2 distance) J with the motion J = (I, -[x]) of a point by the relative twist; and the
  // gradient rotates with A: for its rotation w and the motion dx, dU has the term w . (dx x f).
  void add_curvature(std::vector<LinkPair>& pairs) const override;
  void accept() override;

 private:
  // A link's frame, where its mesh is; or that of B in A's.
  using Frame = Pose;
  // A pressed point.
  struct Pressed {
    int point;
    double depth;
    double pressure;
    double weight;       // area times dp/dd [N/m]
    Vec3 place, normal;  // in the frame of A
  };
  // Points that may be behind A, as long as B has moved by less than the margin from a frame in A's.
  struct NearList {
    bool is_made = false;
    Frame of;
    std::vector<int> points;
    std::vector<Vec3> centres;
  };
  // Sums over pressed points, in the frame of A, about its origin.
  struct Sums {
    Vec3 force;     // on B [N]
    Mat3 products;  // sum of x f^T
    std::array<double, 36> matrix{};
  };
  friend void add_up(const std::vector<Pressed>& pressed, const std::vector<double>& areas, Sums& sums);

  static Frame relative(const Frame& a, const Frame& b);
  // Of the points that may be behind A where B is in its frame.
  void find_behind(const Frame& b);
  bool is_listed(const Frame& b) const;
  void list_near(const Frame& b);
  void press(const DistanceGrid::Behind& behind);
  std::array<double, 36> curvature_of_distance() const;
  Frame end_of(int side, const LinkEnd& end) const;
  void find_pressures();
  void give_wrenches();

  int link_a_, link_b_;
  std::shared_ptr<const DistanceGrid> grid_;
  FoundationSurface triangles_, points_;
  BoxTree tree_;  // of the points
  CartilageModel model_;
  // Of the substep: the links' frames at its start, from their centres of mass; its length.
  Frame start_[2];
  double h_ = 0;
  std::vector<double> start_depths_;  // of damped cartilage [m]
  // Of the last evaluation.
  NearList near_;
  Frame evaluated_;  // of B in that of A
  bool is_evaluated_ = false;
  std::vector<DistanceGrid::Behind> behind_;
  std::vector<Pressed> pressed_;
  Sums sums_;
  Frame frame_a_;    // in the world
  Vec3 centres_[2];  // of mass of the links
  int place_[2];     // among the touched links
};

}  // namespace bt
