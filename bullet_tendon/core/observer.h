// What a link really does under the tendons' wrenches, learned from what it did.
//
// Were nothing else at work, a link would answer to a wrench w about its centre of mass with the
// acceleration R w (+ gravity), R its free response. Motors, contacts, limits and constraints take part of
// that away, and add what they push. Both are read from the last two steps, a the acceleration
// seen (without gravity), d the difference between the steps:
//
//   response   R_eff = L G L with R = L L (the symmetric root); what is held shows as d(a) != R_eff d(w).
//              With s = L d(w), y = L^+ d(a), e = y - G s: G += e e^T/(e.s), the symmetric rank-one update
//              (Conn, Gould and Toint 1991), its eigenvalues kept in [0, 1]: never more than free. One
//              rigid constraint is found by one update.
//   push       r = a - R_eff w, of two steps the smaller by component, so that a blow is not repeated.
//
// A link that was held and yields more along the wrench than R_eff foresaw has been let go: the wrench
// meant a held body, and the step has to be mended (world.py).
#pragma once

namespace bt {

struct Six {
  double v[6] = {};
};
struct Six6 {
  double m[6][6] = {};
};

class Observer {
 public:
  // The link's twist (velocity of the centre of mass, spin) now, and its free response. Gravity
  // [m/s^2] is what it falls with by itself.
  void see(const Six& twist, const Six6& free, const Six& gravity);
  // The twist was set from outside.
  void refresh(const Six& twist);
  // The wrench that acts from now on for dt [s].
  void act(const Six& wrench, double dt);
  // As if nothing was known.
  void forget();
  // As if it was free, from the step before on.
  void let_go();

  bool held() const { return held_; }          // something takes part of the response away
  bool released() const { return released_; }  // it was held before what was seen last
  const Six6& response() const { return effective_; }
  const Six& push() const { return push_; }  // [m/s^2], [rad/s^2]

 private:
  template <class A>
  friend void fields(A& a, Observer& observer);  // state.h
  struct Sample {
    Six wrench, acceleration;
  };
  bool was_released(const Sample& now) const;
  void learn(const Sample& now);
  void find_push();

  Six6 free_, effective_;
  Six6 share_;  // G
  Six twist_, wrench_, push_;
  Sample last_, before_;
  double dt_ = 0;
  int samples_ = 0;  // of the last steps that are known: 0, 1 or 2
  bool known_ = false, acted_ = false, held_ = false, released_ = false;
};

}  // namespace bt
