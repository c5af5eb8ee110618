// The substeps of one step: start and length of the current substep, and the reasons why substeps were solved
// again or cut.
//
// Only this class cuts or repeats substeps. Lengths are integers in units of the step, so that substeps add
// up to the step exactly. One budget limits the linear solutions and the wall time of a whole step. When it
// is exhausted, the substep takes its last iterate, and one substep is the rest of the step
// (World::end_early).
#pragma once
#include <array>

namespace bt {

// Units in a step [-], three times a power of two. One unit is the shortest substep. More: steps that cannot
// be solved cost more, up to the budget. Fewer: light bodies on stiff, taut tendons are not solved.
constexpr int kUnits = 3 * 8192;
// Largest number of times that contacts are detected again for a substep before it is halved, and that stops
// of bodies are for a step [-]. Smaller: more substeps where contacts appear one after another.
constexpr int kMostDetections = 6;

// Why a substep was solved again.
enum class Reason : int {
  motion = 0,       // a tendon moves by more than its radius relative to something near it: cut
  turn,             // a segment turns far in a BDF2 step: divided in three, or with contacts in two
  growth,           // BDF2 would restart, because the last step was much shorter: divided in two
  not_converged,    // an island did not converge within its iterations: halved
  left_prediction,  // particles left their predicted region: contacts are detected again; later halved
  woken,            // a tendon came within reach of a sleeping one, which wakes: repeated
  step_weights,     // tendons in contact had different step weights, or BDF2 and a jump: repeated
  joint_stops,      // joint limits or contacts of a body act differently from the prediction: repeated
  body_rotation,    // a body turns far that was predicted to turn little: repeated
  released,         // a held body yields, or was released or pulled in the step before: repeated
};
using ReasonCounts = std::array<int, static_cast<int>(Reason::released) + 1>;

class Substepper {
 public:
  // Begins a step of dt [s]. divisible: substeps may be shorter than the step.
  void start(double dt, bool divisible) {
    dt_ = dt;
    divisible_ = divisible;
    ends_early_ = false;
    done_ = 0;
    size_ = kUnits;
    taken_ = 0;
    reasons_ = {};
  }
  bool done() const { return done_ == kUnits; }
  double step() const { return dt_; }                            // length of the whole step [s]
  double h() const { return dt_ * size_ / kUnits; }              // length of this substep [s]
  double end() const { return dt_ * (done_ + size_) / kUnits; }  // its end, from the start of the step [s]
  // Shares of the step [-]: this substep; up to its end; before it.
  double share() const { return static_cast<double>(size_) / kUnits; }
  double share_at_end() const { return static_cast<double>(done_ + size_) / kUnits; }
  double share_before() const { return static_cast<double>(done_) / kUnits; }
  // The substep's share of the remaining step [-].
  double share_left() const { return static_cast<double>(size_) / (kUnits - done_); }
  bool is_whole() const { return size_ == kUnits; }
  bool ends_early() const { return ends_early_; }
  bool is_last() const { return done_ + size_ == kUnits; }
  bool divisible() const { return divisible_; }
  bool may_cut() const { return divisible_ && !ends_early_ && size_ > 1; }

  // Solves the substep again: with the same length; halved until it is at most `share` of its length; divided
  // by `parts`. Repeats end: a substep wakes each tendon, restarts each history and lets each body turn far
  // at most once, and detections and changes of stops are limited.
  void repeat(Reason why) { count(why); }
  void cut(Reason why, double share) {
    count(why);
    do {
      size_ /= 2;
      share *= 2;
    } while (share < 1 && size_ > 1);
  }
  void divide(Reason why, int parts) {
    count(why);
    size_ /= parts;
  }
  // Begins the step again.
  void begin_again(Reason why) {
    count(why);
    done_ = 0;
    size_ = kUnits;
    taken_ = 0;
  }
  // Ends the substep. The next one is twice as long where that aligns with the units of the step.
  void accept() {
    done_ += size_;
    ++taken_;
    if (done_ % (2 * size_) == 0 && done_ + 2 * size_ <= kUnits) size_ *= 2;
  }

  // Makes the substep the rest of the step.
  void end_early() {
    size_ = kUnits - done_;
    ends_early_ = true;
  }

  // Whether the step was cut because of something that is near, or ends early.
  bool was_cut() const { return ends_early_ || reasons_[static_cast<int>(Reason::motion)] > 0; }
  int taken() const { return taken_; }
  const ReasonCounts& reasons() const { return reasons_; }

 private:
  void count(Reason why) { ++reasons_[static_cast<int>(why)]; }
  double dt_ = 0;
  bool divisible_ = true, ends_early_ = false;
  int done_ = 0, size_ = kUnits, taken_ = 0;
  ReasonCounts reasons_{};
};

}  // namespace bt
