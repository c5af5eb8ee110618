// The finite rotation of a free rigid body that rotates far in a step.
//
// pybullet rotates a body by the rotation vector psi = g(t) theta, theta = dt w, t = |theta|, w its spin at
// the end of the step: g = 1, but beyond pi/4 g = 2 atan(c t)/t, c = 4/pi tan(pi/8) (btMultiBody). A point at
// the arm r of its centre is taken to exp(psi) r, and a small change of theta moves it by d = (Q d theta) x
// r' with
//
//   r' = exp(psi) r,      Q = T P,      P = g + (g'/t) theta theta^T,
//   T = 1 + A [psi] + B [psi]^2,        A = (1 - cos p)/p^2,        B = (p - sin p)/p^3,        p = |psi|
//
// (T the left Jacobian of the rotation group). By virtual work a force f at the point is the torque Q^T (r' x
// f) on theta. Its change with theta is what keeps light bodies from swinging up under a taut tendon: of the
// order of dt^2 |f| |r| / (moment of inertia), which may be far above one.
#pragma once
#include "math/rotation.h"
#include "math/sym3.h"

namespace bt {

struct FiniteRotation {
  bool far = false;  // false: arms are those at the start of the substep
  // Rotation vectors: predicted from the start of the step to that of the substep, and within the substep;
  // and theta, with what the tendons add.
  Vec3 begun, more, theta;
  Rot3 rotation, rate;  // since the substep began; Q
  // Sum of outer products r' f over the points that are touched. The antisymmetric part is the torque.
  Rot3 pulls;

  // The rotation within the substep, if it ends at this theta.
  Rot3 since_begun(Vec3 theta) const;
  void turn_by(Vec3 by);
  // Adds a force f that gives this torque. Of its arm, only this part turns with the body.
  void add_pull(Vec3 arm, Vec3 f, Vec3 torque);
  // The change of the torque on theta with theta, the symmetric part of it, at the pulls that were added.
  Sym3 stiffness() const;
};

// The rotation by which pybullet moves a body, for the vector theta [rad].
Rot3 rotation_of_step(Vec3 theta);

}  // namespace bt
