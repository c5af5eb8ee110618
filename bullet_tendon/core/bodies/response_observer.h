// What a body really does under the tendons' forces, learned from what it did.
//
// A body has coordinates: the velocity of its centre of mass and its spin, or the rates of its joints (with
// those of its base, where that floats). Were nothing else at work, generalized forces w would change
// its rates by the acceleration R w (+ what gravity does), R = M^-1 its free response. Motors, contacts,
// limits and constraints take part of that away, and add what they push. Both are read from the last two
// steps, a the acceleration seen (without gravity's), d the difference between the steps:
//
//   response   R_eff = L G L^T with R = L L^T (Cholesky); what is held shows as d(a) != R_eff d(w).
//              With s = L^T d(w), y = L^-1 d(a), e = y - G s: G += e e^T/(e.s), the symmetric rank-one update
//              (Conn, Gould and Toint 1991), its eigenvalues kept in [0, 1]: never more than free. One
//              rigid constraint is found by one update.
//   push       r = a - R_eff w, of two steps the smaller by coordinate, so that a blow is not repeated. Of a
//              rate that pybullet cut off, r is the least that it can have been.
//
// Sizes of accelerations are those of the kinetic energy, |L^-1 a|. A body that was held and yields more
// along the forces than R_eff foresaw has been let go: they meant a held body, and the step has to be mended
// (stepping.py).
#pragma once
#include "math/small_matrix.h"

namespace bt {

// Rate at which pybullet cuts off what is faster [m/s], [rad/s]: what did that to it cannot be told. Share of
// it from which a rate is taken for one that was cut off [-]: damping comes after.
constexpr double kMostRate = 100.0;
constexpr double kCutOff = 0.999;

class Observer {
 public:
  using Numbers = dense::Numbers;
  // The rates (n) now, the free response (n n), and what gravity makes of the rates by itself (n). alone: all
  // that it does is known, but for a pull. told: so is what holds it, and nothing is to be learned of that.
  void see(const Numbers& rates, const Numbers& free, const Numbers& gravity, bool alone, bool told);
  // The rates right after what it was thought to do; true where that means that it has been let go. What
  // is seen next may have been set from outside since.
  bool note(const Numbers& rates, const Numbers& gravity);
  // The rates were set from outside.
  void refresh(const Numbers& rates);
  // The generalized forces that act from now on for dt [s].
  void act(const Numbers& forces, double dt);
  // As if it was free, in this step.
  void set_free();
  // As if it was free, from the step before on.
  void let_go();

  // The push of the last step, all of it, is believed; and what two steps agree on again.
  void believe();
  void doubt() { find_push(); }

  bool is_new() const { return samples_ < 2; }             // too little was seen of it yet
  bool held() const { return held_; }                      // something takes part of the response away
  bool released() const { return released_; }              // it was held before what was seen last
  const Numbers& root() const { return effective_root_; }  // E, R_eff = E E^T
  const Numbers& push() const { return push_; }            // acceleration
  const Numbers& forces() const { return forces_; }        // of the last step
  const Numbers& missed() const { return missed_; }        // acceleration not foreseen; empty: not known
  // Whether pybullet cut off some rate in the last step.
  // The same, of the last two steps and whatever touches the body.
  bool was_limited() const { return last_.limited || before_.limited; }
  bool was_cut() const { return !last_.cut.empty() && dense::dot(last_.cut, last_.cut) > 0; }

 private:
  friend struct StateFields;  // world/state_fields.h
  struct Sample {
    Numbers forces, acceleration;
    Numbers cut;           // by rate: its sign where pybullet cut it off, else 0
    bool limited = false;  // pybullet cut some rate off
  };
  void start(int n);
  bool has_acted() const { return known_ && acted_ && dt_ > 0; }
  void sample(const Numbers& rates, const Numbers& gravity);
  void unexplained(const Sample& by, Numbers& rest);
  bool leave_out_cut(const Numbers& rates);
  void compare(const Sample& now);
  bool was_released(const Sample& now);
  void learn(const Sample& now);
  void limit_share();
  void take_effective();
  void find_push();

  int n_ = 0;
  Numbers root_, effective_root_;  // L, E
  Numbers share_, share_root_;     // G, and S with G = S S^T
  Numbers rates_, forces_, push_;
  Numbers missed_;
  Numbers noted_;  // rates after the last step; empty where nobody looked
  Sample last_, before_;
  double dt_ = 0;
  int samples_ = 0;  // of the last steps that are known: 0, 1 or 2
  bool known_ = false, acted_ = false, held_ = false, released_ = false;
  Sample now_;  // work space, like the rest
  dense::Scratch s_, e_, one_, other_, turned_, vectors_;
};

}  // namespace bt
