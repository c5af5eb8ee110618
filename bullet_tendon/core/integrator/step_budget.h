// The work limit of one step.
#pragma once
#include <chrono>
#include <functional>

namespace bt {

// Linear solutions that end a solution in which the budget is exhausted [-]. Larger: less of the wall time is
// left to what comes before. Smaller: shorter substeps are what can be solved.
constexpr long kLastSolves = 4;

// Limits the linear solutions and the wall time of a whole step.
class Budget {
 public:
  // most: linear solutions. seconds: wall time [s]; 0: unlimited. poll: called repeatedly; it may throw,
  // which ends the step.
  void start(long most, double seconds, std::function<void()> poll);
  // Counts one linear solution.
  void spend();
  bool exhausted() const { return exhausted_; }
  // Whether the budget refuses further work. Call it only if there is such work: it records the refusal.
  bool refuses() {
    refused_ |= exhausted_;
    return exhausted_;
  }
  // Begins a solution. It may take this many linear solutions beyond an exhausted budget. For kLastSolves of
  // them, wall time is kept.
  void begin_solution(long beyond);
  // The same, for the next linear solution of a solution.
  bool refuses_solve() { return refuses() && spent_ >= allowed_; }
  // Whether the budget has refused work.
  bool refused() const { return refused_; }
  long spent() const { return spent_; }

 private:
  using Clock = std::chrono::steady_clock;
  long most_ = 0, spent_ = 0, beyond_ = 0, allowed_ = 0;
  bool timed_ = false, exhausted_ = false, refused_ = false;
  Clock::time_point end_, last_;
  Clock::duration longest_{};  // from one linear solution to the next
  std::function<void()> poll_;
};

}  // namespace bt
