// A ligament: a massless line that pulls on links along a path of points, through which it slides freely.
//
// With the points p_i of links and the length L of the path, its tension is a function of L alone,
//
//   T(L) = K f(L/l - 1) + C d((L - L_0)/(h l)),      (tendon/axial_law.h)
//
// with l the rest length, L_0 the length at the start of the substep and h its length. A tension that is set
// replaces T(L). The elastic part K f may relax, and a ligament may rupture (tendon/tissue.h); then it has no
// tension any more.
//
// The tension is the same along the whole path, because the points have no friction. It has
// the potential U(L), U' = T, with
//
//   dU/dp_i = T g_i,   g_i = dL/dp_i,      d2U/dp_i dp_j = T' g_i g_j^T + T d2L/dp_i dp_j,
//
// and d2L is that of its straight segments, (I - u u^T)/|segment| with u along the segment, which is positive
// semidefinite.
//
// A force T between two points has no direction where they meet, as those of a muscle do that has drawn two
// bones together. There they are held together by up to T: below the length e, that of a segment d counts as
// d^2/(2 e) + e/2, which is smooth and convex, with the derivatives d/e and I/e.
//
// A compressed ligament, which only a material that can push allows, makes the second term
// negative.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

#include "element/element.h"
#include "ligament/wrap.h"
#include "tendon/material.h"

namespace bt {

// A point of the path.
struct PathPoint {
  int link = -1;  // slot
  Vec3 local;     // in the link's frame [m]
};

// What only the user changes.
struct LigamentModel {
  double rest = 0;      // rest length [m]
  double tension = -1;  // that is set [N]; negative: the material's law
};

// What a step changes.
struct LigamentState {
  double force = 0;            // tension at the end of the last step [N]
  double unrelaxed = 0;        // T_e [N]
  std::vector<double> memory;  // m_i [N]
  bool begun = false;          // unrelaxed and memory are those of a substep that began
  bool ruptured = false;
};

class Ligament : public Element, public LigamentModel, public LigamentState {
 public:
  Ligament(const std::vector<PathPoint>& path, const std::vector<Wrap>& wraps, const Material& material,
           double rest_length);
  const std::vector<PathPoint>& path() const { return path_; }
  const std::vector<Wrap>& wraps() const { return wraps_; }
  const Material& material() const { return material_; }

  void begin(const std::vector<Link>& links, double h) override;
  void evaluate(const std::vector<LinkEnd>& ends) override;
  void add_stiffness(std::vector<LinkPair>& pairs, bool definite) const override;
  void add_curvature(std::vector<LinkPair>& pairs) const override;
  void accept() override;
  // Length of the path where the links are now [m], and its points, those where it meets and leaves wraps
  // included.
  double length_at(const std::vector<Link>& links, std::vector<Vec3>& points) const;

 private:
  // Derivatives of the length by the twists of the touched links.
  using Twists = std::array<double, 6>;
  // A direction across a segment: its twists, and 1/|segment|.
  struct Across {
    int one, other;  // touched links
    Twists by_one, by_other;
    double inverse;
  };
  void find_tension();
  void find_length(const std::vector<LinkEnd>& ends);
  template <class NodeAt, class FrameAt, class Visit>
  void each_part(NodeAt node, FrameAt frame, std::vector<Geodesic>& near, Visit visit) const;
  // Length of the path where the links are now [m]: with its points the true one, else as it counts.
  double measure(const std::vector<Link>& links, std::vector<Geodesic>& near,
                 std::vector<Vec3>* points) const;
  // A point of the path, or one where it meets a wrap.
  struct Node {
    int touched;
    Vec3 arm, point;
  };
  // A straight part of the path between two links; the direction is from the first node to the last. It is
  // shorter than 1 where they nearly meet.
  struct Straight {
    Node first, last;
    Vec3 direction;
  };
  // A part of the path around a wrap, and where the wrap and its link's centre of mass are.
  struct Bent {
    size_t wrap;
    Pose frame;
    Vec3 centre;
    Node first, last;
  };
  void add_straight(const Node& first, const Node& last);
  void add_across(const Straight& part, Vec3 across, double inverse);
  double least() const;
  int place_of(int link) const;

  std::vector<PathPoint> path_;
  Material material_;
  std::vector<Wrap> wraps_;
  std::vector<int> of_point_;  // touched link of each point
  // Of the substep: arms of the points at its start; frames of the wraps, from the links' centres of mass;
  // length of the path at its start; its length [s].
  std::vector<Vec3> arms_;
  std::vector<Pose> wrap_frames_;
  std::vector<Geodesic> near_;  // of the last evaluation, by part of the path and wrap
  double start_length_ = 0, h_ = 0;
  Relaxation relaxation_;
  double recalled_ = 0;  // [N]
  // Of the last evaluation.
  std::vector<Straight> straights_;
  std::vector<Bent> bent_;
  std::vector<Twists> gradient_;  // of the length, by touched link
  std::vector<Across> across_;
  double length_now_ = 0, tension_now_ = 0, slope_ = 0, unrelaxed_now_ = 0;
};

}  // namespace bt
