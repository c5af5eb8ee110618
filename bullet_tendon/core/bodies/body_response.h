// A pybullet body in generalized coordinates, and its response to forces.
//
// The links of a body share its coordinates. J is the Jacobian of a link (velocity of its centre of mass,
// spin), E the root of the response (bodies/response_observer.h). A force f at a point of a link, at the arm
// r from its centre of mass, gives the displacement u of a point of the body within a step:
//
//   B = s [I, -[r]] J E,     u = B y,     y = B^T f,     s^2 = (time since the step began) (length of the
//   substep).
//
// Therefore y, with the energy |y|^2/2, are the unknowns of the body (solver/body_schur.cpp), whatever holds
// the body.
//
// Joint limits, contacts with bodies without mass and motors are predicted (bodies/body_stops.h).
#pragma once
#include <utility>

#include "bodies/body_history.h"
#include "bodies/body_stops.h"
#include "bodies/response_observer.h"
#include "math/vec3.h"

namespace bt {

// A body in a substep (begin_substep).
struct BodySubstep {
  // Change of the rates since the step began, at the start and at the end of the substep, without the forces
  // of the tendons in it.
  Numbers changed, changes_to;
  Numbers pushed;       // impulses of the tendons in past substeps
  Numbers last_forces;  // generalized, of the tendons in the last substep; empty: it is the first
};

// Motion that a step over budget leaves out. The tendons end after a share s of the step, in which they moved
// the body by s dt times its rates. pybullet moves it by dt times its rates at the end of the step. Therefore
// these are s times those that were solved, and the next step begins with the others. Otherwise the body
// would be moved beyond its solution by (1 - s) dt times its rates, which is unstable on a stiff tendon.
struct MotionLeftOut {
  Numbers owed;   // change of the rates with which this step begins; empty: none
  Numbers kept;   // rates at the end of a step that left motion out; empty: it left none out
  Numbers force;  // generalized, on pybullet's body in this step: of both; empty: none
};

// The unknowns of a body in the solution of an island.
struct BodyUnknowns {
  bool any = false;
  Numbers y, residual;     // (n)
  Numbers dy, correction;  // change of y, and its second-order correction (solver/arc.cpp)
  int first = 0;           // index of the first one among the body unknowns of the island
  double lever = 0;        // largest |B| of its touched points
};

// Whether a free body rotates finitely in this step: tendons can touch it, or it turns so far that the arms
// of their ends change.
struct BodyTurning {
  bool far = false;
  bool elements = false;  // elements act on it in this step
  Vec3 torque;            // of the tendons in the last solution [N m]
  double pull = 0;        // sum of |force| |arm| of the tendons [N m]
  double lever = 0;       // largest |arm| [m]
};

// Of a rigid body that moves by itself, in world axes at the start of the step.
struct Inertia {
  Sym3 moments;       // [kg m^2]; zero: not known
  Rot3 axes;          // by columns, the principal ones
  Vec3 slender_axis;  // that of the least moment; zero: the body is not slender
  bool is_slender() const { return norm(slender_axis) > 0; }
  // What pybullet's gyroscopic torque at the spin w lacks in a step of dt [s] to that at the mean of the
  // spins before and after it [N m]. pybullet's, at the spin before it, adds energy: (dt w)^2 of it in a
  // step.
  Vec3 gyroscopic_shift(Vec3 w, double dt) const;
};

struct GeneralizedBody {
  // Current rates (n): of the base, the velocity of its centre of mass and its spin; of the joints.
  Numbers rates;
  Numbers free;              // free response M^-1 (n n)
  Numbers gravity_response;  // acceleration per unit of gravity (n 3); empty: not known
  Inertia inertia;
  // Acceleration by its own motion (n): centrifugal, Coriolis and gyroscopic terms, and damping of joints.
  Numbers by_motion;
  // Generalized forces of its motion at the velocity at the start of the step, less those at the mean
  // velocity of the last step, which pybullet applies (n); empty: not known.
  Numbers motion_shift;
  // What pybullet's forces of the motion lack in this step (n): motion_shift of a body that continues by
  // BDF2, else Inertia::gyroscopic_shift. Empty: nothing. Each prediction finds it anew.
  dense::Scratch motion_lacks;
  // Generalized forces that pybullet is given besides those of the tendons (n): of limits that joints would
  // pass in this step, motion_lacks, and of left_out.
  Numbers joint_forces;
  Numbers external;  // generalized forces of the user in this step (n); empty: none
  BodyStops stops;
  Observer observer;
  BodyHistory history;
  Numbers root;    // E, reduced by the stops that act in this step
  Numbers change;  // predicted change of the rates in the whole step, by all but the tendons
  BodySubstep substep;
  MotionLeftOut left_out;
  Numbers forces;  // generalized forces of the tendons in this step
  BodyTurning turning;
  int touches = 0;          // number of attachments and contacts of tendons
  bool limited = false;     // it could pass through cartilage in this substep
  bool stays = false;       // it is left out of the rest of the step (world/early_end.cpp)
  bool point_mass = false;  // it is a spring in the tendon's matrix (World::aim_attachments)
  BodyUnknowns unknowns;

  int n() const { return static_cast<int>(rates.size()); }
  // Whether it is more than a rigid body: joints have two limits each, wherever they are.
  bool is_jointed() const { return !stops.limits.empty() || n() > 6; }
  // Number of rates that are of its bases, whose velocity pybullet integrates: 6 each, or 0 where it is
  // fixed.
  int base() const {
    if (gravity_response.empty()) return 0;
    return stops.limits.empty() ? n() : static_cast<int>(stops.limits[0]);
  }
  // Learns from its motion since the last step.
  void sense();
  // Adds a generalized force of the user to those of this step.
  void add_external(const Numbers& force);
  // Predicts its motion in the step.
  void predict(double dt, Vec3 gravity);
  // Determines whether it continues by BDF2 in a step that may be `whole`, not divided.
  bool begin_history(double dt, Vec3 gravity, bool whole);
  // Adds what its history gives to the prediction. E is scaled by b/dt, because the end forces act by b^2.
  void continue_history(double dt);
  // Energies of the changes of velocity by the known forces of the step before and by all forces of the last
  // step [J].
  std::pair<double, double> energies_of_change(double dt);
  // Acceleration by gravity and by the forces of the user in this step (n).
  const Numbers& known_acceleration();
  // Takes its rates and the forces of its motors right after the step. Returns whether it was released.
  bool sample(const Numbers& after, const Numbers& motors);
  // Whether a hold, or a motor, of unknown limit may be found to yield. One that has withstood what would
  // throw the body at the rate that pybullet cuts off is never seen to.
  bool holds_to_unknown_limit() const {
    return (observer.held() && !observer.held_firmly()) || !stops.limits_are_known();
  }
  // Whether no force of tendons moves it.
  bool is_held_firmly() const {
    return observer.held_firmly() || (n() > 0 && stops.hold_firmly(root, observer.free_root()));
  }
  // Whether these forces of the tendons (n) overpower a motor in a step of dt [s].
  bool overpowered(const Numbers& by, double dt) { return stops.overpowered(stopped(), by, dt); }
  // Whether what holds it may have released it in the last step.
  bool may_be_released() const { return observer.held() || stops.motors.any() || stops.constraints_act(); }
  // Whether it did.
  bool released() const { return observer.released() || stops.motors.thrown || stops.constraints_released(); }
  // Whether it did at the limit of a motor or constraint, which the last step was not solved with.
  bool released_at_limit() const {
    return (stops.motors.thrown || stops.constraint_yielded()) && !observer.released();
  }
  // The rates at the end of a step of dt [s] as it was solved (n).
  const Numbers& rates_at_end(double dt);
  // If what holds it is not trusted with the forces of the tendons in a step of dt [s], lets it yield.
  bool limit_hold(double dt);
  // Records the forces of the tendons and of the stops in a step of dt [s].
  void act(double dt);
  // Whether it rotates far within dt [s] with this predicted spin, or under the forces of the tendons.
  bool turns_far(Vec3 spin, double dt) const;
  // Determines the stops that act under the forces of the tendons. Returns whether they are other ones than
  // before.
  bool settle_stops(double dt);
  // Whether the stops act as the forces of the solution ask for.
  bool stops_settled(double dt);
  // Forgets the substeps.
  void begin_step();
  // Sets `changed` and `changes_to`. before, at_end: shares of the step that are over then [-].
  void begin_substep(double before, double at_end);
  // Ends its motion in a step of dt [s] after this share of the step [-].
  void leave_out(double share, double dt);
  // Adds the generalized impulse of a substep of h [s].
  void push(const Numbers& impulse, double h);
  // Generalized forces of the tendons in the last substep, or in the last step; empty: not known.
  const Numbers& last_forces() const {
    return substep.last_forces.empty() ? observer.forces() : substep.last_forces;
  }
  bool knows_last_forces() const { return static_cast<int>(last_forces().size()) == n(); }
  // Their effect by E: y = E^T f.
  void answer_last_forces(Numbers& y) const { dense::multiply_transposed(root, last_forces(), y); }
  // Share of them, whose effect is y, that holds the body in this step of dt [s] [-]: as far as they take
  // back, in the metric of its mass, what else changes its rates.
  double share_that_holds(const Numbers& y, double dt) const;

 private:
  const Numbers& known(Vec3 gravity);
  // Twice the kinetic energy of a change of velocity by this acceleration in a second [J].
  double energy_of(const Numbers& acceleration);
  // Whether the known forces differ suddenly from those of the last step.
  bool is_jerked();
  // Determines the motion that the last step owes to this one.
  void take_owed();
  // Adds that motion to the prediction.
  void give_owed(double dt);
  const Numbers& unforced();
  BodyStops::Body stopped() { return {rates, observer, root, change}; }
  Numbers explain_stops(const Numbers& reported, const Numbers& reached);
  Numbers known_in_step_;  // acceleration by gravity and its own motion in the last step
  struct Workspace {
    dense::Scratch known, half, forces, along, acceleration;
  };
  Workspace work_;
  friend struct StateFields;  // world/state_fields.h
};

}  // namespace bt
