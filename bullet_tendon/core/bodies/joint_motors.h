// Motors of the joints of a body, learned from the forces that pybullet reports of them.
//
// In every step pybullet's motor sets the rate u of its joint to an aim, by a force f of at most its limit L:
//
//   u = aim, |f| <= L,     or     f = L, u < aim,     or     f = -L, u > aim.
//
// So it is a row of the complementarity problem of the body's stops (bodies/body_stops.cpp). pybullet
// reports f, but neither aim nor limit. They are learned:
//
//   aim    Within its limit it was u. It goes on from there by what its last two changes have in common. One
//          that took its joint faster than that by its limit has an aim that is farther: it is taken to be
//          out of reach until the motor gives less.
//   limit  Not known until the motor yields: u is short of the foreseen aim, and f of the force for it. Until
//          then it is taken for what shows whether the motor yields (BodyStops::bound_motor), and for
//          infinite once that was withstood. If f is the largest of the motor so far, this is its limit. If
//          it is less, the user has lowered the limit or changed the aim. It is taken for a lower limit if it
//          is short by much, unless the motor was within a limit that is known, or its aim has changed by as
//          much before.
//
// pybullet reports a wrong force of a motor that is off (Observer::forces_of_motors), and too small a one
// where it cuts off the rate (JointMotors::add_cut_off).
//
// A motor that yields where it was not foreseen to has released its joint: the step is solved again
// (world/resolve.cpp).
#pragma once
#include <algorithm>
#include <limits>
#include <vector>

#include "math/small_matrix.h"

namespace bt {

// Force of a motor whose limit is not known [N m], [N]: saved states are finite.
constexpr double kUnlimited = std::numeric_limits<double>::max();

struct JointMotor {
  double aim = 0;             // rate of the last step [rad/s], [m/s]; +-kMostRate: out of reach
  double gained = 0;          // change of the aim in the last step over its length
  double trend = 0;           // what the last two have in common
  double leap = 0;            // largest change of the aim in a step, within the limit
  double foreseen = 0;        // aim with which the step was solved
  double needed = 0;          // force with which it was solved [N m], [N]
  double force = 0;           // of the last step
  double limit = kUnlimited;  // largest force
  double greatest = 0;        // largest force that it gave
  int side = 0;               // sign of the force with which it is at its limit; 0: it is within
  int lets = 0;               // the same, of one that yields for the rest of the step
  bool solved = false;        // the step was solved with it
  bool known = false;         // it gave a force in the last step
};

inline bool any_push(const Numbers& forces) {
  return std::any_of(forces.begin(), forces.end(), [](double force) { return force != 0; });
}

class JointMotors {
 public:
  // Learns from the rates reached (n) and the forces (n) in a step of dt [s]. Returns whether any has
  // released its joint.
  bool observe(const Numbers& reached, const Numbers& forces, double dt);
  // Whether any has released its joint, by the same.
  bool released(const Numbers& reached, const Numbers& forces) const;
  // Adds to the forces (n) of those that held their joints the ones (n) by which pybullet cut off the rates
  // before they acted: what they hold is as large as that.
  void add_cut_off(const Numbers& reached, const Numbers& cut_off, Numbers& forces) const;
  // Sets the aims foreseen for a step of dt [s].
  void foresee(double dt);
  void begin_step() {
    thrown = false;
    for (JointMotor& m : all) m.lets = 0;
  }
  // Before the first step of the body that is known, at these rates (n): by what pybullet reports of its last
  // step.
  void begin(const Numbers& rates);
  bool any() const {
    for (const JointMotor& m : all)
      if (m.known) return true;
    return false;
  }
  // Whether pybullet reported a force of any in the last step.
  bool any_reported() const { return any_push(reported); }

  std::vector<JointMotor> all;  // by coordinate
  // Generalized forces that pybullet reports of the last two steps (n).
  Numbers reported, reported_before;
  Numbers reports;              // what pybullet reports now: after a restore, of later steps
  Numbers off;                  // 1: it was off in the last step, and what is reported of it is older (n)
  bool reported_known = false;  // they are known for the next step (pybullet does not restore them)
  bool thrown = false;          // any released its joint in the last step
  bool again = false;           // the last step is solved again
  bool soft = false;            // pybullet's sweeps do not solve them
};

}  // namespace bt
