// The response of a body to the tendons' forces, learned from its motion.
//
// Generalized forces w alone would change the rates of a body by the acceleration R w (and gravity's), R =
// M^-1 its free response. Motors, contacts, limits and constraints take part of this away, and push by
// themselves. Both are learned from the last two steps, a the acceleration that was seen (without gravity's),
// d the difference between the steps:
//
//   response   R_eff = L G L^T with R = L L^T (Cholesky); what is held shows as d(a) != R_eff d(w).
//              With s = L^T d(w), y = L^-1 d(a), e = y - G s: G += e e^T/(e.s), the symmetric rank-one update
//              (Conn, Gould and Toint 1991), its eigenvalues kept in [0, 1]: never more than free. One
//              rigid constraint is found by one update.
//   push       r = a - R_eff w, of two steps the smaller by coordinate, so that an impact is not repeated. Of
//              a rate that pybullet cut off, r is the least possible one.
//
// Accelerations are compared by the norm of the kinetic energy, |L^-1 a|. A body that was held and yields
// more along the forces than R_eff predicted has been released. Then the forces were those on a held body,
// and the step has to be solved again (world/resolve.cpp).
#pragma once
#include "math/small_matrix.h"

namespace bt {

// Rate at which pybullet cuts off [m/s], [rad/s]. Share of it from which a rate counts as cut off [-]:
// damping comes after the cut.
constexpr double kMostRate = 100.0;
constexpr double kCutOff = 0.999;

class Observer {
 public:
  using Numbers = dense::Numbers;
  // Learns from the rates (n) now, with the free response (n n), and gravity's acceleration (n). alone: the
  // motion of the step before was predicted completely, but for a push. stops_known: so are the stops that
  // hold it, and nothing is learned.
  void observe(const Numbers& rates, const Numbers& free, const Numbers& gravity, bool alone,
               bool stops_known);
  // The rates right after the step; whether they mean that it was released. Rates that are observed later may
  // have been set from outside since.
  bool sample(const Numbers& rates, const Numbers& gravity);
  // The rates were set from outside.
  void refresh(const Numbers& rates);
  // The generalized forces that act from now on for dt [s].
  void act(const Numbers& forces, double dt);
  // As if it was free, in this step.
  void set_free();
  // As if it was free, from the step before on.
  void let_go();

  // The push is that of the last step; or the part that the last two steps agree on.
  void trust_last();
  void require_two() { find_push(); }

  bool is_new() const { return samples_ < 2; }             // fewer than two steps are known
  bool held() const { return held_; }                      // something takes part of the response
  bool released() const { return released_; }              // it was held until the last step
  const Numbers& root() const { return effective_root_; }  // E, R_eff = E E^T
  const Numbers& push() const { return push_; }            // acceleration
  const Numbers& forces() const { return forces_; }        // of the last step
  const Numbers& missed() const { return missed_; }  // acceleration that was not predicted; empty: not known
  // Whether pybullet cut off some rate in the last step.
  bool was_cut() const { return !last_.cut.empty() && dense::dot(last_.cut, last_.cut) > 0; }

 private:
  friend struct StateFields;  // world/state_fields.h
  struct Sample {
    Numbers forces, acceleration;
    Numbers cut;  // by rate: its sign where pybullet cut it off, else 0
  };
  void start(int n);
  bool has_acted() const { return known_ && acted_ && dt_ > 0; }
  void measure(const Numbers& rates, const Numbers& gravity);
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
  Numbers sampled_;  // rates right after the last step, if sampled
  Sample last_, previous_;
  double dt_ = 0;
  int samples_ = 0;  // steps that are known: 0, 1 or 2
  bool known_ = false, acted_ = false, held_ = false, released_ = false;
  Sample now_;  // work space, like the rest
  dense::Scratch s_, e_, one_, other_, turned_, vectors_;
};

}  // namespace bt
