// A pybullet link: its pose, its motion with its body, and the wrench of the tendons on it.
#pragma once
#include "bodies/body_response.h"
#include "bodies/finite_rotation.h"

namespace bt {

// Velocity of the centre of mass and spin [m/s], [rad/s]; or displacement and rotation in a substep [m],
// [rad].
struct Twist {
  Vec3 linear, angular;
  Vec3 at(Vec3 r) const { return linear + cross(angular, r); }
  bool is_zero() const { return norm(linear) == 0 && norm(angular) == 0; }
};
inline Twist operator+(Twist a, Twist b) { return {a.linear + b.linear, a.angular + b.angular}; }
inline Twist operator-(Twist a, Twist b) { return {a.linear - b.linear, a.angular - b.angular}; }
inline Twist operator*(double s, Twist a) { return {s * a.linear, s * a.angular}; }

// About the centre of mass [N], [N m].
struct Wrench {
  Vec3 force, torque;
};
inline Wrench operator+(const Wrench& a, const Wrench& b) { return {a.force + b.force, a.torque + b.torque}; }
inline Wrench operator*(double s, const Wrench& a) { return {s * a.force, s * a.torque}; }

// Of the tendons on a link, if its body has a history (bodies/body_history.h): G and F of the last step, and
// what they give to F in this step. A body that turns far answers to Q^T (r' x f) (bodies/finite_rotation.h),
// which is the torque r' x f turned back by half of the rotation. G is that of r' x f. What it exceeds Q^T by
// is taken from the last step.
struct WrenchHistory {
  Wrench mean, applied, given;
  Vec3 excess;      // sum of r' x f - Q^T (r' x f) at the end of the last step [N m]
  Vec3 excess_now;  // and of this one

  void begin(double steady_share) {
    given = (2.0 / 9) * mean + (steady_share / 3) * applied + Wrench{{}, (4.0 / 9) * excess};
  }
  void finish(const Wrench& wrench, bool continues, double steady_share) {
    mean = continues ? 1.5 * wrench + (-0.5 * steady_share) * applied : wrench;
    mean.torque += continues ? (2.0 / 3) * (excess_now - excess) : excess_now;
    applied = wrench;
    excess = excess_now;
  }
};

// Where a link is at the end of a substep, at the present iterate.
struct LinkEnd {
  Vec3 centre;    // centre of mass [m]
  Rot3 rotation;  // since the start of the substep
  Vec3 at(Vec3 arm) const { return centre + rotation * arm; }
};

// Motion of a link that is foreseen for the substep.
struct Foreseen {
  Twist all, given;  // displacement: with the unknowns of the body, and the part of it that is theirs
  Rot3 turn;
  bool far = false;  // as FiniteRotation::far
};

// Where a link was at the start of the step.
struct LinkStart {
  Pose pose;
  Vec3 centre;
  bool known = false;  // it was read for a step
};

// Where the forces of attachments act on a link: at the start of the substep or, at_end, where their points
// are predicted to end.
struct AttachmentArms {
  bool at_end = false;
  // Rotation of the arms to there, in the step with the spin at its start. Motion beyond it is linear: with
  // the spin that is predicted without the tendons, their forces would have to undo a far turn.
  Rot3 turn;
};

// A link at an iterate of a solution with unknowns of its body.
struct LinkIterate {
  dense::Numbers reached;  // J E (6 n), with the angular part of the rotation if the link rotates far
  Twist given, stepped;    // displacement by the unknowns, and by their last change
  Wrench load;             // of the residual
  FiniteRotation turned;
};

struct Link {
  Pose pose;    // of the URDF link frame, at the start of the substep
  Vec3 centre;  // centre of mass, world axes, at the start of the substep [m]
  LinkStart start;
  Twist rates;          // at the start of the step
  Twist drift_rates;    // mean in the substep, without the forces of the tendons in it
  Foreseen foreseen;    // motion within the substep, for which contacts are detected
  Vec3 curving;         // acceleration of its centre of mass by its joints' present rates [m/s^2]
  double friction = 0;  // coefficient of its surface that pybullet has, the lateral one [-]
  int body = -1;        // -1: tendons do not move it
  AttachmentArms attachment_arms;
  bool yielded = false;  // tendons could move it in the last step
  // Its pose or its friction has changed, or it has a velocity, since the last step began.
  bool moved = false;
  // Of a link without mass or velocity that was put elsewhere since the last step, and the substep's share.
  Twist put, shifted;
  dense::Numbers jacobian;  // J (6 n); empty: the identity, of a free rigid body
  dense::Numbers root;      // J E (6 n)
  WrenchHistory history;
  Wrench wrench;      // of the tendons in the finished substeps, averaged over the step
  Wrench read, late;  // as AnchorForce::read, and AnchorForce::late [N s], [N m s]
  Wrench part;        // contribution of the substep that was solved last
  Wrench correction;  // of an iterate that is not a solution (solver/body_schur.h)
  LinkIterate iterate;

  bool yields() const { return body >= 0; }
  // Coefficient of a surface on it that has its own, or, if that is negative, the link's.
  double friction_of(double own) const { return own < 0 ? friction : own; }
  bool rests() const { return !yields() && rates.is_zero(); }
  // Updates `moved` and `put`. Call it after the link was read and before `start` is set.
  void note_motion();
  // Sets drift_rates and what it has turned, in a substep between these times since the step began [s].
  void begin_substep(const GeneralizedBody* m, double before, double at_end);
  // Sets drift_rates to those predicted for the end of the step, and `root`.
  void go_with(const GeneralizedBody& m);
  // Sets the pose to that at the end of the substep, `time` [s] after the start of the step.
  void advance_to(const GeneralizedBody* m, double time);
  // Velocity and spin after a change of the body's rates.
  Twist rates_after(const dense::Numbers& change) const;
  // Foresees that the unknowns give this displacement in a substep of dt. far: its body turns far.
  void foresee(const Twist& given, double dt, bool far);
  // Where it is at the end of a substep of dt, which ends `time` after the start of the step [s], by the
  // unknowns of its body. Links of bodies that turn far are where they turn to.
  LinkEnd end(double dt, double time) const;
  // Where the point of an attachment is after dt, without the tendons.
  Vec3 ahead_of(Vec3 local, double dt) const;
  // Displacement of the world point p within dt, without the tendons.
  Vec3 drift(Vec3 p, double dt) const { return dt * drift_rates.at(p - centre); }
  // The same, and what it was shifted by before.
  Vec3 carry(Vec3 p, double dt) const { return drift(p, dt) + shifted.at(p - centre); }
  Vec3 foreseen_at(Vec3 p) const { return foreseen.all.at(p - centre); }
  // Where a frame that is fixed to it is foreseen to be at the end of the substep.
  Pose foreseen_pose(const Pose& frame) const;
  // The same of a point. Where the link does not turn far, that moves linearly, as attachments do.
  Vec3 foreseen_point(Vec3 x) const;
  // Mobility of the world point p: W = [I, -[r]] R [I, -[r]]^T [1/kg].
  Sym3 mobility(Vec3 p) const;
  // Adds a force at the world point p, averaged over the step [N].
  void apply(Vec3 f, Vec3 p) {
    wrench.force += f;
    wrench.torque += cross(p - centre, f);
  }
  // From the centre of mass to a point of the link's frame, at the start of the substep.
  Vec3 arm_of(Vec3 local) const { return to_world(pose, local) - centre; }
  // The same of an attachment. On an articulated body with a history, or that tendons can touch, it is that
  // of the predicted end, to which the force belongs.
  Vec3 held_arm_of(Vec3 local) const { return attachment_arms.turn * arm_of(local); }
  // The arm at the end of the substep.
  Vec3 now(Vec3 arm) const { return iterate.turned.rotation * arm; }
  // Sets the finite rotation from the predicted one and from the unknowns.
  void turn(const GeneralizedBody& m);
  // Displacement of the point at the arm by the unknowns. If the link rotates far, relative to the straight
  // predicted path.
  Vec3 displaced(Vec3 arm) const;
  // Its displacement by the last change of the unknowns.
  Vec3 stepped(Vec3 arm) const { return iterate.stepped.at(now(arm)); }
  // The displacement by the unknowns, relative to where the link is foreseen to be.
  Vec3 displaced_from_foreseen(Vec3 arm) const;
  Rot3 turned_from_foreseen() const;
  // Generalized torque of a force at the arm on theta (bodies/finite_rotation.h) [N m].
  Vec3 torque_of(Vec3 f, Vec3 arm) const;
  // Twist by the unknowns, or by their change, divided by s.
  Twist twist_of(const dense::Numbers& y) const;
  // The same; if the link rotates far, the angular part is the change of theta.
  Twist spin_of(const dense::Numbers& y) const;
  // Adds the generalized force by^T wrench.
  void add_generalized(const dense::Numbers& by, const Wrench& wrench, dense::Numbers& to) const;
};

}  // namespace bt
