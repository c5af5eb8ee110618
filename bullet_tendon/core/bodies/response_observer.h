// The response of a body to the tendons' forces, learned from its motion.
//
// The forces w accelerate a free body by R w (besides gravity), R = M^-1 its free response. Motors, contacts,
// limits and constraints reduce this response, and add accelerations of their own. Both are learned from the
// last two steps. a is the observed acceleration (without gravity's), d the difference between the steps:
//
//   response   R_eff = L G L^T with R = L L^T (Cholesky). A held body has d(a) != R_eff d(w).
//              With s = d(L^T w), y = d(L^-1 a), e = y - G s: G += e e^T/(e.s), the symmetric rank-one update
//              (Conn, Gould and Toint 1991). The eigenvalues of G are limited to [0, 1], because no response
//              exceeds the free one. One update finds one rigid constraint.
//   push       r = a - R_eff w, the smaller one of two steps by coordinate, so that an impact is not
//              repeated. For a rate that pybullet cut off, r is the least possible one.
//   hold       h = a - R w, by what holds the body. |L^-1 h| is at most what it is trusted with: what it was
//              seen to yield at, else a share more than it has withstood. Beyond, the body answers freely,
//              pushed by the h that it is trusted with, as by a motor of limited force.
//
// Accelerations are compared in the norm of the kinetic energy, |L^-1 a|. A held body that moved more along
// the forces than R_eff predicted has been released. The forces of that step were those on a held body.
// Therefore the step is solved again (world/resolve.cpp).
#pragma once
#include "math/rotation.h"
#include "math/small_matrix.h"

namespace bt {

// Smallest relative change of the forces from which the observer learns, smallest error of the prediction
// relative to the acceleration by gravity, motion and stops, and by the forces at joint limits, and smallest
// reduction of the response [-]: rounding and noise. Of the force of a motor that is at its limit, least that
// it lacks, as a share of what was foreseen.
constexpr double kLeastNews = 1e-3;
// Smallest evidence of a changed response [-]: the error of the prediction as a share of the free response to
// the change of the forces (of a held body that is released, to the forces). Of a motor, the same as above
// where it gave more before. Larger: released light bodies are thrown. Smaller: steps of held bodies are
// solved twice.
constexpr double kEvidence = 0.1;

// Rate at which pybullet cuts off [m/s], [rad/s], and share of it from which a rate counts as cut off [-],
// because pybullet damps after it cuts off.
constexpr double kMostRate = 100.0;
constexpr double kCutOff = 0.999;
class Observer {
 public:
  // What is known of the last step. alone: the motion of a rigid body was predicted completely, except for a
  // push. jointed: it is an articulated body. stops_known: its stops are predicted, and nothing is learned.
  // joined: constraints hold it, and no hold is learned: what pybullet's sweeps over constraints leave would
  // seem to be one. noise: error of the rates, from which nothing is learned. motors: generalized
  // forces of the motors of its joints (n); empty: none. thrown: one of them has released its joint.
  struct Circumstances {
    bool alone, jointed, stops_known, joined;
    double noise;
    const Numbers& motors;
    bool thrown;
  };
  // Learns from the current rates (n), the free response (n n) and gravity's acceleration (n).
  void observe(const Numbers& rates, const Numbers& free, const Numbers& gravity, const Circumstances& of);
  // Takes the rates right after the step. Returns whether the body was released. Rates that are observed
  // later may have been set from outside.
  bool sample(const Numbers& rates, const Numbers& gravity, const Numbers& motors);
  // The forces of motors in the last step, by what pybullet reports of them. All (n).
  struct Reported {
    const Numbers &before, &now;  // in the step before and in this one
    // 1: the motor was off. pybullet goes on to report the last force of one that is switched off.
    Numbers& off;
  };
  Numbers forces_of_motors(const Numbers& rates, const Numbers& gravity, const Reported& reported);
  // Generalized forces (n) by which pybullet cut off the rates in the last step, before its motors acted.
  // known: accelerations in it beside those by what acts (n).
  Numbers cut_off(const Numbers& known);
  // Takes forces of the tendons that are expected in the next step (n).
  void expect(const Numbers& forces) { forces_ = forces; }
  // Turns what is known of a slender rigid body's last steps with the body, to these axes of it and its free
  // response there. Forces at the ends of a rod do not spin it: had they stayed in the axes of the world,
  // what turned it would seem to.
  void turn_to(const Rot3& axes, const Numbers& free);
  // Takes rates that were set from outside.
  void refresh(const Numbers& rates);
  // Records the generalized forces that act during the next dt [s]: of the tendons, and all others that are
  // known: of the limits ahead, and the user's.
  void act(const Numbers& tendons, const Numbers& others, double dt);
  // Records the generalized forces of the tendons on a body that was put at rest.
  void rest(const Numbers& tendons);
  // Treats the body as free from this step on.
  void set_free();
  // Treats a body that nothing can hold as free, and forgets the last steps if something held it in them.
  void let_go();
  // Lets it yield in a step in which it was released, at the force that its motion shows, as a motor of
  // limited force does. If pybullet cut off its rate, that is not known, and the body is free.
  void release();

  // Sets the push to that of the last step.
  void trust_last();
  // After the last step was solved again: sets the push to the part that the last two steps have in common. A
  // body that yielded in it is held again, up to that force.
  void resume();

  // If what holds the body is not trusted with these forces of the tendons in a step of dt [s], lets it yield
  // until the step is observed. Returns whether it did.
  bool limit_hold(const Numbers& tendons, double dt);

  // Whether a step was taken since the rates were read last.
  bool has_acted() const { return known_ && acted_ && dt_ > 0; }
  double dt() const { return dt_; }  // length of the last step [s]
  // The rates right after the last step, if they were sampled, else these.
  const Numbers& reached(const Numbers& rates) const { return sampled_.empty() ? rates : sampled_; }
  bool held() const { return hold_.acts; }  // R_eff is less than the free response
  bool held_firmly() const { return hold_.acts && hold_.firm; }
  // R_eff is the free response, or is taken for it because the hold yields.
  bool responds_freely() const { return !hold_.acts || hold_.yields; }
  bool released() const { return released_; }              // it was held until the last step
  const Numbers& root() const { return effective_root_; }  // E, R_eff = E E^T
  const Numbers& free_root() const { return root_; }       // L, R = L L^T
  const Numbers& push() const { return push_; }            // acceleration
  const Numbers& forces() const { return forces_; }        // of the tendons in the last step
  const Numbers& missed() const { return missed_; }  // acceleration that was not predicted; empty: not known
  // Whether most of the last motion, beside that by these accelerations, was not predicted.
  bool is_surprised(const Numbers& accelerations);
  // Whether pybullet cut off some rate in the last step.
  bool was_cut() const { return !last_.cut.empty() && dense::dot(last_.cut, last_.cut) > 0; }
  // The same of the velocity of a rigid body: a pull on it is then not known.
  bool velocity_was_cut() const {
    return was_cut() && (last_.cut[0] != 0 || last_.cut[1] != 0 || last_.cut[2] != 0);
  }

 private:
  friend struct StateFields;  // world/state_fields.h
  struct Sample {
    Numbers forces, acceleration;
    // L^T w and L^-1 a, with the L of their step: the body has moved since, and L with it.
    Numbers root_forces, root_acceleration;
    Numbers cut;  // by rate: its sign if pybullet cut it off, else 0
  };
  void start(int n);
  double norm_of_hold(const Numbers& forces, const Numbers& acceleration);
  void let_yield(double share);
  void end_yielding();
  void note_hold();
  bool has_yielded();
  void measure(const Numbers& rates, const Numbers& gravity, const Numbers& motors);
  void unexplained(const Numbers& root, const Numbers& forces, const Numbers& acceleration, Numbers& rest);
  void unexplained(const Sample& by, Numbers& rest);
  void leave_out_cut();
  bool note_cut(const Numbers& rates, bool thrown);
  void compare(const Sample& now);
  bool was_released(const Sample& now);
  void learn(const Sample& now, const Numbers& gravity, const Circumstances& of);
  void limit_share();
  void take_effective();
  void find_push();

  // What holds the body.
  struct Hold {
    bool acts = false;         // R_eff is less than the free response
    bool begun = false;        // it was learned from the last step, which no rate that was cut off preceded
    bool yields = false;       // the body was let yield in this step
    bool limit_known = false;  // it was seen to yield at `withstood`
    bool firm = false;         // it withstood what would throw the body at the rate that pybullet cuts off
    double withstood = 0;      // largest |L^-1 (a - R w)| since it holds
    Numbers push;              // push without yielding
  };
  struct Workspace {
    Sample now;
    dense::Scratch s, e, one, other, turned, vectors, momenta;
  };

  int n_ = 0;
  Numbers root_, effective_root_;  // L, E
  Numbers share_, share_root_;     // G, and S with G = S S^T
  Numbers rates_, forces_, push_;
  Numbers applied_;  // all known forces in the last step
  Numbers missed_;
  Numbers sampled_;  // rates right after the last step, if sampled
  Hold hold_;
  Sample last_, previous_;
  Rot3 axes_;  // as turn_to
  bool axes_known_ = false;
  double dt_ = 0;
  int samples_ = 0;  // number of known steps: 0, 1 or 2
  bool known_ = false, acted_ = false, released_ = false;
  Workspace work_;
};

}  // namespace bt
