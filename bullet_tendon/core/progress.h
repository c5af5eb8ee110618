// Whether the iterations of a Newton solution (newton.cpp) still get anywhere: contacts along a straight wall
// are let go one by one, which takes many iterations and is no reason to give up.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "constants.h"

namespace bt {

class Progress {
 public:
  explicit Progress(size_t rows)
      : patience_(std::min(kMostPatience, kMixedIterations + static_cast<int>(rows) / kContactsAnIteration)) {
  }

  // After an iteration that left this residual. true: patience is at an end.
  bool stalled(double residual) {
    ++idle_;
    if (residual < kProgress * best_) best_ = residual, idle_ = 0;
    return idle_ > patience_;
  }

  // true: they go round, or have got nowhere for a while.
  bool circles(double residual) {
    const bool again = std::any_of(seen_.begin(), seen_.end(), [&](double r) {
      return std::fabs(r - residual) <= kSameResidual * residual;
    });
    seen_[count_++ % seen_.size()] = residual;
    return again || idle_ > kIdle;
  }

 private:
  int patience_, idle_ = 0;
  double best_ = std::numeric_limits<double>::infinity();
  std::array<double, kLongestCircle> seen_{};  // the last residuals
  size_t count_ = 0;
};

}  // namespace bt
