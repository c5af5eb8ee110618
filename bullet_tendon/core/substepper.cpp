#include "substepper.h"

#include <utility>

namespace bt {

namespace {

// Linear solutions between two polls [-]. More: Ctrl-C waits longer. Fewer: the interpreter is locked for
// nothing.
constexpr long kBetweenPolls = 64;

}  // namespace

void Budget::start(long most, double seconds, std::function<void()> poll) {
  most_ = most;
  spent_ = 0;
  exhausted_ = false;
  timed_ = seconds > 0;
  if (timed_)
    end_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  poll_ = std::move(poll);
}

void Budget::spend() {
  ++spent_;
  exhausted_ |= spent_ >= most_ || (timed_ && Clock::now() >= end_);
  if (poll_ && spent_ % kBetweenPolls == 0) poll_();
}

void Substepper::start(double dt, bool divisible) {
  dt_ = dt;
  divisible_ = divisible;
  done_ = 0;
  size_ = kUnits;
  taken_ = repeats_ = 0;
  reasons_ = {};
}

void Substepper::repeat(Reason why) {
  count(why);
  ++repeats_;
}

void Substepper::cut(Reason why, double share, const Budget& budget) {
  count(why);
  repeats_ = 0;
  do {
    size_ /= 2;
    share *= 2;
  } while (share < 1 && size_ > smallest(budget));
}

void Substepper::divide(Reason why, int parts) {
  count(why);
  repeats_ = 0;
  size_ /= parts;
}

void Substepper::accept() {
  done_ += size_;
  ++taken_;
  repeats_ = 0;
  if (done_ % (2 * size_) == 0 && done_ + 2 * size_ <= kUnits) size_ *= 2;
}

}  // namespace bt
