// The substeps of one step: where the next one begins, how long it is, and why one was solved again or cut.
//
// It is the only one that repeats a part of a step. Lengths are counted in units of the step, so that
// substeps add up to it exactly. The work of a whole step has one budget, of linear solutions and of wall
// time: once that is used up, a substep is no longer solved again, and takes the iterate that there is.
#pragma once
#include <array>

#include "integrator/step_budget.h"

namespace bt {

// Units of a step [-], three times a power of two: the shortest substep that motion near a body or another
// tendon can ask for.
constexpr int kUnits = 3 * 8192;
// Substeps that a step without convergence is cut into at most [-]. More: violent steps cost more before they
// are given up. Fewer: a step of seconds of a stiff, folded tendon may stay unsolved.
constexpr int kMostSubsteps = 2048;
// The same once the budget is used up [-]: motion is still limited, so that nothing passes through anything.
constexpr int kMostOverBudget = 64;
// Times that a substep of one length is solved again at most, whatever the reason [-].
constexpr int kMostRepeats = 64;
// Times that contacts are detected again for a substep before it is halved [-]. Fewer: more substeps where
// contacts appear one after another.
constexpr int kMostDetections = 6;

// Why a substep was solved again.
enum class Reason : int {
  motion = 0,       // something near a contact moves by more than its radius: cut
  turn,             // a segment turns far in a step of second order: cut in three, or beside contacts in two
  growth,           // BDF2 would begin anew, because the last step was so much shorter: cut in two
  not_converged,    // an island has no solution within its iterations: halved
  left_prediction,  // particles ended where contacts were not looked for: contacts are detected again, then
                    // halved
  woken,            // an island at rest was reached
  step_weights,     // tendons that press on each other had step weights of different methods
  joint_stops,      // joint limits or contacts of a body act otherwise than predicted
  body_rotation,    // a body turns far that was taken to turn little
};
constexpr int kReasons = 9;
using ReasonCounts = std::array<int, kReasons>;

class Substepper {
 public:
  // divisible: whether substeps may be shorter than the step.
  void start(double dt, bool divisible);
  bool done() const { return done_ == kUnits; }
  double step() const { return dt_; }                            // length of the whole step [s]
  double h() const { return dt_ * size_ / kUnits; }              // of this substep [s]
  double end() const { return dt_ * (done_ + size_) / kUnits; }  // of it, from the start of the step [s]
  double share() const { return static_cast<double>(size_) / kUnits; }
  double share_at_end() const { return static_cast<double>(done_ + size_) / kUnits; }
  double share_before() const { return static_cast<double>(done_) / kUnits; }
  // Its share of what is left of the step.
  double share_left() const { return static_cast<double>(size_) / (kUnits - done_); }
  bool is_whole() const { return size_ == kUnits; }
  bool is_last() const { return done_ + size_ == kUnits; }
  bool divisible() const { return divisible_; }
  // Whether a substep without convergence is cut.
  bool may_halve() const { return divisible_ && size_ > kUnits / kMostSubsteps; }
  bool may_cut(Budget& budget) const {
    return divisible_ && size_ > 1 && (size_ > smallest(budget) || !budget.refuses());
  }
  bool may_repeat() const { return repeats_ < kMostRepeats; }

  // The substep is solved again, with the same length, or cut to that share of it, by halves; or in `parts`.
  void repeat(Reason why);
  void cut(Reason why, double share, const Budget& budget);
  void divide(Reason why, int parts);
  // The substep was taken. The next one is twice as long where that fits.
  void accept();

  int taken() const { return taken_; }
  const ReasonCounts& reasons() const { return reasons_; }

 private:
  static int smallest(const Budget& budget) { return budget.exhausted() ? kUnits / kMostOverBudget : 1; }
  void count(Reason why) { ++reasons_[static_cast<int>(why)]; }
  double dt_ = 0;
  bool divisible_ = true;
  int done_ = 0, size_ = kUnits, taken_ = 0, repeats_ = 0;
  ReasonCounts reasons_{};
};

}  // namespace bt
