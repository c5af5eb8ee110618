// A pybullet link as the core sees it: a placement that moves, as the body does that it is of, and the
// wrench that the tendons put on it.
#pragma once
#include "bodies/body_response.h"
#include "bodies/finite_rotation.h"

namespace bt {

// Velocity of the centre of mass and spin; or what they make of a step.
struct Twist {
  Vec3 linear, angular;
  Vec3 at(Vec3 r) const { return linear + cross(angular, r); }
};

// About the centre of mass [N], [N m].
struct Wrench {
  Vec3 force, torque;
};
inline Wrench operator+(const Wrench& a, const Wrench& b) { return {a.force + b.force, a.torque + b.torque}; }

struct Link {
  Pose pose;        // of the URDF link frame, at the start of the step, or of a part of it
  Vec3 centre;      // centre of mass, world [m]
  Pose start_pose;  // both as the step began
  Vec3 start_centre;
  Vec3 now_velocity, now_spin;  // as the step began
  Vec3 velocity, spin;          // foreseen for its end, but for the tendons [m/s], [rad/s]
  int body = -1;                // none: nothing that tendons do moves it
  bool yielded = false;         // in the last step
  bool moved = false;           // it has been elsewhere or has a velocity, since the last step began
  dense::Numbers jacobian;      // (6 n); empty: the identity
  dense::Numbers root;          // J E (6 n)
  Wrench wrench;                // of the tendons, averaged over the step: of the substeps that are done
  Wrench part;                  // what the substep that was solved last adds to that
  // In a solution in which its body is unknown: J E Q, what the unknowns and their change make of its place,
  // and the residual.
  dense::Numbers reached;  // (6 freedom)
  Twist given, stepped, load;
  FiniteRotation turned;

  bool yields() const { return body >= 0; }
  // Told anew, and the step's start still being the last one's.
  void note_motion();
  // How the body's foreseen motion carries it.
  void follow(const GeneralizedBody& m);
  // That, and the root of its response.
  void go_with(const GeneralizedBody& m);
  // The root of the body's unknowns.
  void reach(const GeneralizedBody& m);
  // What the unknowns but for s make of the point at the arm, in one direction of space (n).
  dense::Numbers motion_of(int direction, Vec3 arm) const;
  // Goes on to `time` after the start of the step, with the velocity that it is thought to have.
  void advance_to(double time);
  // Displacement of the world point p within dt from where it is, were it not for the tendons.
  Vec3 drift(Vec3 p, double dt) const { return dt * (velocity + cross(spin, p - centre)); }
  // Response of the point p to a force there: W = [I, -[r]] R [I, -[r]]^T [1/kg].
  Sym3 mobility(Vec3 p) const;
  // A force at the world point p, in the whole step.
  void apply(Vec3 f, Vec3 p) {
    wrench.force += f;
    wrench.torque += cross(p - centre, f);
  }
  // Of an attached point, from the centre of mass, as the part begins.
  Vec3 arm_of(Vec3 local) const { return to_world(pose, local) - centre; }
  // A free rigid body. Its rotation in a step is finite; links on joints turn to first order.
  bool turns() const { return yields() && jacobian.empty(); }
  // An arm as it is at the end of the substep.
  Vec3 now(Vec3 arm) const { return turned.rotation * arm; }
  // FiniteRotation as far as `share` of the part takes it, and as the unknowns do.
  void turn(const GeneralizedBody& m, double share);
  // What the unknowns make of the place at the arm; turning, of its straight way as well.
  Vec3 displaced(Vec3 arm) const;
  // Torque of a force at the arm, on the rotation of the step.
  Vec3 torque_of(Vec3 f, Vec3 arm) const;
  // The twist that unknowns (or their change) mean, over s, and the generalized force that a wrench means.
  Twist twist_of(const dense::Numbers& y) const;
  Twist spin_of(const dense::Numbers& y) const;  // the same as its own spin, where it turns far
  void add_generalized(const dense::Numbers& through, const Twist& wrench, dense::Numbers& to) const;
};

}  // namespace bt
