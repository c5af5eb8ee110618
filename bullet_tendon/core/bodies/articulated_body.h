// Jacobians and mass matrix of trees of rigid links on joints (Featherstone 2008, chapters 4 and 6).
// The first links are the bases of the trees. With b of them, joint k carries link b + k. Degrees of freedom:
// of each floating base, the velocity of its centre of mass and its spin, in world axes; then those of the
// joints in order.
#pragma once
#include <vector>

#include "math/rotation.h"
#include "math/sym3.h"

namespace bt {

// R diag(d) R^T
inline Sym3 turned(const Rot3& r, Vec3 d) {
  const Rot3 columns = transposed(r);
  return d.x * outer(columns.r0) + d.y * outer(columns.r1) + d.z * outer(columns.r2);
}

enum class JointKind { hinge, slider, ball, fixed };

struct Joint {
  JointKind kind;
  int parent;  // link
  Vec3 axis;   // in the inertial frame of the link that it carries; a ball's are that frame's own
  Vec3 pivot;  // in the inertial frame of the parent
  Rot3 turn;   // of the inertial frame of the link in that of the parent, where the joint is at zero
  double lower = 1, upper = 0;  // limits of a hinge [rad] or slider [m]; none where lower > upper
  double damping = 0;           // torque or force per rate [N m s] or [N s/m]
};

// Mass [kg] and principal moments [kg m^2] of a link, and its inertial frame in its own frame, whose origin
// is the joint.
struct LinkInertia {
  double mass;
  Vec3 moments, centre;
  Rot3 turn;
};

class Articulated {
 public:
  // floating: by tree, whether its base moves.
  Articulated(const std::vector<Joint>& joints, const std::vector<bool>& floating);
  int trees() const { return static_cast<int>(floating_.size()); }
  int links() const { return static_cast<int>(links_.size()); }
  int dofs() const { return static_cast<int>(twists_.size()); }
  int places() const { return places_; }
  bool floats(int tree) const { return floating_[tree]; }
  // The tree of a link, which is also its base.
  int tree_of(int link) const { return links_[link].tree; }
  int rates_of_bases() const { return base_; }
  bool moves(int link) const { return !links_[link].moved_by.empty(); }
  // inertias: of every link. bases: by tree, centre of mass 3 and inertial frame 4 of its base in the world.
  // places: of the joints that move, a ball's 4 (quaternion).
  void place(const std::vector<LinkInertia>& inertias, const double* bases, const double* places);
  // Centre of mass, inertial frame and frame of a link, once it was placed.
  Vec3 centre(int link) const { return base_at_ + links_[link].centre; }
  Pose inertial_frame(int link) const { return {links_[link].turn, centre(link)}; }
  Pose frame(int link) const { return {links_[link].frame, base_at_ + links_[link].joint}; }
  // out (6, dofs): velocity of the link's centre of mass, then its spin, world axes.
  void jacobian(int link, double* out) const;
  // out (dofs, 3): the sum of m J_v^T over the links, the generalized force of a unit of gravity.
  void weight(double* out) const;
  // out (dofs, dofs): the sum of J^T diag(m 1, I) J over the links.
  void mass_matrix(double* out) const;
  // rates (dofs). out (dofs): minus the velocity terms sum J^T (m a, I dw/dt + w x I w) at constant rates
  // (Featherstone 2008, section 5.3: centrifugal, Coriolis and gyroscopic).
  void inertial_force(const double* rates, double* out) const;
  // The generalized force that the motion causes by itself: the same, minus the damping of the joints,
  // explicit as pybullet applies it.
  void velocity_force(const double* rates, double* out) const;
  // out, by link: acceleration of its centre of mass at constant rates [m/s^2].
  void curvings(const double* rates, std::vector<Vec3>& out) const;
  // out: coordinate, side and depth (bodies/body_response.h) of both limits of all joints. places: as in
  // `place`.
  void limits(const double* places, std::vector<double>& out) const;
  // What acts on a link at a point, and reversed on its parent, if a force or torque acts on a degree of
  // freedom. parent -1: of a floating base.
  struct JointForce {
    int link, parent;
    Vec3 force, point, torque;
  };
  JointForce force_of(int dof, double amount) const;

 private:
  struct Placed {
    std::vector<int> moved_by;  // degrees of freedom that move it
    int tree = 0;
    Vec3 centre;  // from the first base's centre of mass: rounding does not grow with its place
    Rot3 turn;    // of the inertial frame
    Vec3 joint;   // origin of the link's own frame, from the first base's centre of mass
    Rot3 frame;   // of that frame
    double mass = 0;
    Sym3 inertia;  // world axes
  };
  // Velocity of a link, and its acceleration at constant rates: of the point of it that is at the first
  // base's centre of mass, and angular (spatial vectors, Featherstone 2008, chapter 2).
  struct Motion {
    Vec3 velocity, spin, acceleration, turning;
  };
  // Motion by a unit rate: spin, and velocity of the point at the first base's centre of mass.
  struct Twist {
    int carried = 0;
    bool slides = false;
    Vec3 axis, velocity, spin;
    double lower = 1, upper = 0, damping = 0;
    int place = 0;  // among those of the joints
  };
  void place_inertia(Placed& link, const LinkInertia& inertia);
  std::vector<Motion> motions_at(const double* rates) const;
  std::vector<Joint> joints_;
  std::vector<bool> floating_;
  std::vector<Placed> links_;
  std::vector<Twist> twists_;
  Vec3 base_at_;    // the first one
  int base_ = 0;    // degrees of freedom of all bases
  int places_ = 0;  // number of joint position values
};

// b <- mass^-1 b, with b (n, columns) and the mass matrix (n, n). A degree of freedom whose pivot is
// rounding, without mass, has no response.
void answer(int n, int columns, const double* mass, double* b);

}  // namespace bt
