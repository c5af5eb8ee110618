// Rounds of a Newton solution (newton.cpp): what follows the solution, friction limits, the stiffness of what
// is too deep, and pairs that were missed, stands still within a round, so that each minimises a fixed
// potential.
#pragma once
#include "constants.h"
#include "stepping.h"

namespace bt {

class Rounds {
 public:
  int begun() const { return begun_; }  // with which iteration this one
  bool over() const { return count_ >= kRounds; }
  // After its first residual, over the forces at hand.
  void note_start(double residual) {
    if (fresh_) loose_ = kNextRound * residual, fresh_ = false;
  }
  // Solved well enough to see to what follows it.
  bool near_end(int iteration, double residual) const { return iteration > begun_ && residual <= loose_; }
  // Nothing to be seen to before it is solved exactly.
  void settle() { loose_ = 0; }
  // What follows the solution follows it, where that changes forces by more than `enough` [N].
  // true: it did, and the next round begins.
  bool next(Group& group, int iteration, double enough);

 private:
  int count_ = 0, begun_ = 0;
  double loose_ = kLooseRound;
  bool fresh_ = false;  // what it begins with is not known yet
};

}  // namespace bt
