// Constraints between links, as the user gives them to pybullet (p.createConstraint), as rows d of the body
// that they join, with its rates u and the standing rate s of what the body does not move:
//
//   d u + s = -share error/dt,     |force| <= most.
//
// BodyStops predicts them together with its other rows.
#pragma once
#include <functional>
#include <vector>

#include "math/rotation.h"
#include "math/small_matrix.h"

namespace bt {

enum class ConstraintKind { point, fixed, gear };

// One of the two sides of a constraint.
struct ConstraintEnd {
  int link = -1;        // of the body; -1: what the body does not move
  Pose frame;           // of the constraint, in the link's inertial frame, or in the world
  Vec3 velocity, spin;  // of the frame's origin, by what the body does not move [m/s], [rad/s]
  int coordinate = -1;  // of the joint that a gear turns
};

struct LinkConstraint {
  ConstraintKind kind;
  ConstraintEnd a, b;
  double most;       // force or torque of each row [N], [N m]
  double ratio = 0;  // of a gear: rate of a, plus the ratio times the rate of b, is zero [-]
};

struct ConstraintRow {
  dense::Numbers direction;  // d (n)
  double error = 0;          // of the places [m], [rad]
  double standing = 0;       // s [m/s], [rad/s]
  double most = 0;           // [N], [N m]
};

// A link of the body: its inertial frame in the world, and its Jacobian (6 n).
struct ConstrainedLink {
  Pose inertial;
  dense::Numbers jacobian;
};

// Appends the rows of a constraint on a body with n rates. at: the link of an index.
void add_constraint_rows(const LinkConstraint& constraint, int n,
                         const std::function<ConstrainedLink(int)>& at, std::vector<ConstraintRow>& rows);

}  // namespace bt
