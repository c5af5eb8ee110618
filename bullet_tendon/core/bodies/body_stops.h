// What stops a body in a step: joint limits, contacts with bodies without mass, motors of joints, and
// constraints of the user.
//
// Where the rate along a direction d would violate a limit or a contact, pybullet sets a rate that corrects a
// share of the depth. A motor sets the rate of its joint, a constraint one that corrects its error. These
// rows are predicted (bodies/body_stops.cpp).
#pragma once
#include <algorithm>
#include <vector>

#include "bodies/bounded_rows.h"
#include "bodies/joint_motors.h"
#include "bodies/link_constraints.h"
#include "bodies/response_observer.h"

namespace bt {

// A stop exists if it corrected at least this share of the rate that was missing [-].
constexpr double kLeastStopped = 0.5;

class BodyStops {
 public:
  // The body that they stop, with n rates.
  struct Body {
    const Numbers& rates;      // at the start of the step (n)
    const Observer& observer;  // of its response without stops
    // Prediction of the whole step, which they change: root of the response (n n), and change of the rates by
    // all but the tendons (n).
    Numbers &root, &change;
  };

  // Of joints. The contacts are those of a rigid body, or of bodies that move together.
  Numbers limits;  // (coordinate, side, depth) of every limit; side 1: it pushes upwards
  // Of every contact: direction (n), distance, negative inside, and the pair of links that touch. Of every
  // row of friction: direction (n), largest force by the last normal forces, its ratio to these, and the
  // pair.
  Numbers contacts, frictions;
  bool contacts_known = false;  // they are those of the next step (pybullet does not restore its own)
  JointMotors motors;
  std::vector<ConstraintRow> constraints;  // of this step
  // (coordinate, change) of every joint that is moved to just behind its limit before this step.
  Numbers shifts;

  // Determines which limits of the last step the body passed through, which are ignored, and whether contacts
  // bore it.
  void doubt(const Numbers& rates);
  // Whether rates that were reached (n) are nearer to those without the constraints that acted.
  bool broke(const Numbers& reached) const;
  // Notes whether they broke in the last step, of dt [s], in which these rates were reached (n). What
  // pybullet did not keep is ignored until its rates are kept.
  void watch_constraints(const Numbers& reached, double dt);
  // Whether they broke, or yielded where they were not expected to.
  bool constraints_released() const { return broke_ || yielded_; }
  bool constraint_yielded() const { return yielded_; }
  void begin_step() { broke_ = yielded_ = false; }
  // Takes for a step that is solved again what was seen of the constraints after it.
  void correct_constraints(const BodyStops& seen);
  bool constraints_act() const {
    return any_acts([](const Stop& s) { return s.constraint >= 0; });
  }
  // Finds the rows of a step of dt [s]. base: number of rates that are of the base.
  void find(const Body& of, int base, double dt);
  // Determines those that act under these forces of the tendons (n). Returns whether they changed.
  bool choose(const Body& of, const Numbers& forces, double dt);
  // Whether they would change, without changing them.
  bool would_change(const Body& of, const Numbers& forces, double dt);
  // Whether a motor that holds its joint yields to these forces of the tendons (n).
  bool overpowered(const Body& of, const Numbers& forces, double dt);
  // Takes the directions of those that act from the response, and sets the rates along them.
  void act_on(const Body& of, double dt);
  // Lets the motors yield to the end of the step that were within their limits before. Returns whether there
  // are any.
  bool let_motors_yield();
  // Whether there are rows, of n rates, that pybullet solves by sweeps, but for those of a rigid body.
  bool are_swept(int n) const { return !limits.empty() || !constraints.empty() || n > 6; }
  // Before any has acted in a step.
  void rest(int n);
  // Splits what they do in the step under these forces of the tendons (n) into what pybullet does by itself
  // and the generalized forces that it is given, added to `given` (n).
  void share(const Body& of, const Numbers& forces, double dt, Numbers& given);
  // Finds what pybullet's stops did in the last step, with the forces that its motors have given (n).
  void explain(const Body& of, const Numbers& forces, const Numbers& by_motors);

  bool any() const { return !all_.empty(); }
  bool act() const {
    return any_acts([](const Stop&) { return true; });
  }
  // Whether limits or contacts act.
  bool limits_act() const {
    return any_acts([](const Stop& s) { return !s.sets_rate(); });
  }
  // Whether the limits of the motors that hold joints are known, or too large to be found out (Stop::firm).
  bool limits_are_known() const;
  // Whether limits, constraints, and motors whose limits are that large, leave nothing (root) of the free
  // response (n n).
  bool hold_firmly(const Numbers& root, const Numbers& free_root) const;
  // Whether contacts are predicted to stop it.
  bool contacts_stop() const { return !contacts.empty(); }
  // Acceleration by those of pybullet in the last step (n); empty: not known.
  const Numbers& accelerates() const { return by_pybullet_; }

 private:
  friend struct StateFields;  // world/state_fields.h
  template <class Is>
  bool any_acts(Is is) const {
    return std::any_of(all_.begin(), all_.end(), [&](const Stop& s) { return s.acts && is(s); });
  }
  void find_limits(const Body& of, double dt);
  void find_contacts(const Body& of, double dt);
  void find_spins(const Body& of, int base);
  void find_motors(const Body& of, double dt);
  void bound_motor(Stop& motor, double thrown) const;
  void find_constraints(const Body& of, double dt);
  void find_frictions(const Body& of);
  void find_within(size_t width);
  bool yielded(double dt) const;
  void note_unstopped(const Body& of, const Numbers& forces, double dt);
  bool is_held(const Body& of, int coordinate);
  bool may_yield(const Stop& stop) const;
  void add_row(const Body& of, const Stop& stop);
  void add_stop(const Body& of, double wanted, int coordinate, double ahead);
  double rate_at(size_t limit, double dt) const;
  double bounded_by_limits(int coordinate, double aim, double dt) const;
  void push_steadily(const Body& of, const std::vector<int>& coordinates, double dt);
  void find_pushes(const Body& of, const Numbers& forces, double dt);
  void limit_frictions(double dt);
  bool lower_frictions(double dt);
  double normal_force(int pair, double dt) const;
  BoundedRows rows(double dt) const;
  bool stops_yielding_motor(size_t row) const;
  bool admit(const Body& of, const Numbers& forces, double dt);
  bool choose_holding(const Body& of, const Numbers& forces, double dt);
  bool pybullet_cuts_off(const Body& of, const Numbers& forces, const Numbers& given, double dt);
  double share_cut_off(const Body& of, const Numbers& forces, double dt, const Numbers& given);
  void give_cut_off(const Body& of, const Numbers& forces, double dt, Numbers& given);
  bool motors_act() const {
    return any_acts([](const Stop& s) { return s.motor; });
  }
  bool shift_to_limits(const Body& of, bool answered, double dt);
  void give(size_t row, double share, double dt, Numbers& given);
  void find_by_pybullet(const Body& of, double dt);
  void note_motors(const Numbers& swept, double dt);
  void push_by_bounded(const Body& of, double dt);
  void gather_acting(size_t width);
  void take_away(const Body& of);

  std::vector<Stop> all_;
  Numbers directions_;    // D (n in each row)
  Numbers pushes_;        // lambda of all stops, of the last evaluation
  Numbers unstopped_;     // change of the rates without stops and without tendons
  Numbers doubted_;       // by coordinate, not 0: it passed the limit that pybullet reports
  bool rested_ = false;   // contacts stopped the body in the last step
  bool broke_ = false;    // pybullet did not keep the constraints in the last step
  bool yielded_ = false;  // a constraint gave no more than a limit that was not known before
  bool ignored_ = false;  // the constraints are ignored
  bool steady_ = false;   // motors are taken to push as in the last step
  Numbers by_pybullet_;   // acceleration by pybullet's stops in the last step
  // Only `through` (D E) and `within` (D R D^T), of all stops, are valid for a whole step.
  struct Workspace {
    dense::Scratch known, half, direction, through, within, within_acting, within_root, missing, given, along,
        left, whole, bounded;
  };
  Workspace work_;
};

// Sets after (n) to the rates under these forces of the tendons (n) in a step of dt [s], with this response
// and change of the rates. half: workspace.
void rates_under(const dense::Numbers& forces, const dense::Numbers& rates, const dense::Numbers& root,
                 const dense::Numbers& change, double dt, dense::Numbers& half, dense::Numbers& after);

}  // namespace bt
