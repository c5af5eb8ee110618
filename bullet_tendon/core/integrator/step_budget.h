// The work that one step may take.
#pragma once
#include <chrono>
#include <functional>

namespace bt {

// Linear solutions and wall time that a whole step may take.
class Budget {
 public:
  // most: linear solutions; seconds: of wall time, 0 for any. poll: called now and then; it may throw, which
  // ends the step.
  void start(long most, double seconds, std::function<void()> poll);
  // One linear solution more.
  void spend();
  bool exhausted() const { return exhausted_; }
  // Whether work that is left to do is not done any more. It is asked only where there is such work.
  bool refuses() {
    refused_ |= exhausted_;
    return exhausted_;
  }
  // Whether it refused anything.
  bool refused() const { return refused_; }
  long spent() const { return spent_; }

 private:
  using Clock = std::chrono::steady_clock;
  long most_ = 0, spent_ = 0;
  bool timed_ = false, exhausted_ = false, refused_ = false;
  Clock::time_point end_;
  std::function<void()> poll_;
};

}  // namespace bt
