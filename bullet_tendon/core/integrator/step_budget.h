// The work limit of one step.
#pragma once
#include <chrono>
#include <functional>

namespace bt {

// Iterations for which wall time is kept [-], as long as the longest one so far. They end a solution. Larger:
// less of the time is used. Smaller: it is exceeded by more where iterations are long.
constexpr int kKept = 2;

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
  // Begins a solution, which may take this many linear solutions beyond an exhausted budget.
  void begin_solution(long beyond);
  // The same, for the next linear solution of a solution.
  bool refuses_solve() { return refuses() && spent_ >= allowed_; }
  // Whether the budget has refused work.
  bool refused() const { return refused_; }
  long spent() const { return spent_; }

 private:
  using Clock = std::chrono::steady_clock;
  long most_ = 0, spent_ = 0, allowed_ = 0;
  bool timed_ = false, exhausted_ = false, refused_ = false;
  Clock::time_point end_, last_;
  Clock::duration longest_{};  // iteration
  std::function<void()> poll_;
};

}  // namespace bt
