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
// (T the left Jacobian of the rotation group).
//
// By virtual work a force f at the point is the torque Q^T (r' x f) on theta. Its change with theta is what
// keeps light bodies from swinging up under a taut tendon: of the order of dt^2 |f| |r| / (moment of
// inertia), which may be far above one.
//
// A slender body turns about its axis a of least inertia first, then across it: with u = g theta and s = u -
// (a.u) a
//
//   rotation = exp(s) exp((a.u) a),      Q = (T(s) (1 - a a^T) + exp(s) a a^T) P.
//
// Points on the axis do not move with a.theta. With one rotation vector they do where the axis turns, by half
// of a.theta, so that what pulls at the ends of a rod would spin it: by the ratio of its moments of inertia
// faster than it turns, and next step's gyroscopic torque would turn that into energy. pybullet is given the
// spin that takes the body there.
#pragma once
#include "math/rotation.h"
#include "math/sym3.h"

namespace bt {

struct FiniteRotation {
  bool far = false;  // false: arms are those at the start of the substep
  Vec3 axis;         // a, at the start of the step; zero: none
  // Rotation vectors as pybullet takes them, without the tendons: from the start of the step to that of the
  // substep, and within the substep.
  Vec3 begun, more;
  Vec3 predicted, theta;  // theta at the end of the substep, without the tendons and with them
  Rot3 rotation;          // since the substep began
  Mat3 rate = Rot3{};     // Q
  // Sum of outer products r' f over the points that are touched. The antisymmetric part is the torque.
  Mat3 pulls;

  // Sets the axis, and what it turns by without the tendons.
  void begin(Vec3 about, Vec3 before, Vec3 within_substep);
  // The rotation within the substep, if it ends at this theta.
  Rot3 since_begun(Vec3 theta) const;
  void turn_by(Vec3 by);
  // Adds a force f that gives this torque. Of its arm, only this part turns with the body.
  void add_pull(Vec3 arm, Vec3 f, Vec3 torque);
  // The change of the torque on theta with theta, the symmetric part of it, at the pulls that were added.
  Sym3 stiffness() const;
  // What pybullet's rotation vector changes by more than theta by the tendons [rad].
  Vec3 beyond_theta() const;
};

// The rotation by which pybullet moves a body, for the vector theta [rad].
Rot3 rotation_of_step(Vec3 theta);

}  // namespace bt
