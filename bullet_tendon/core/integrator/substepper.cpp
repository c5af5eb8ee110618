#include "integrator/substepper.h"

namespace bt {

void Substepper::start(double dt, bool divisible) {
  dt_ = dt;
  divisible_ = divisible;
  done_ = 0;
  size_ = kUnits;
  taken_ = 0;
  reasons_ = {};
}

void Substepper::cut(Reason why, double share, const Budget& budget) {
  count(why);
  do {
    size_ /= 2;
    share *= 2;
  } while (share < 1 && size_ > smallest(budget));
}

void Substepper::divide(Reason why, int parts) {
  count(why);
  size_ /= parts;
}

void Substepper::accept() {
  done_ += size_;
  ++taken_;
  if (done_ % (2 * size_) == 0 && done_ + 2 * size_ <= kUnits) size_ *= 2;
}

}  // namespace bt
