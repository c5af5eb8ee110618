// How a Newton solution is kept from going astray.
#pragma once
#include <algorithm>
#include <limits>

#include "solver/island.h"

namespace bt {

// Newton iterations with carried multipliers without progress (the residual under this share of the
// best so far) before the step is split [-]. Mixed iterations may raise the residual on their way, so
// less patience splits what would converge; more makes violent steps slower.
constexpr int kMixedIterations = 10;
// The same for every so many contacts besides, and at most: contacts are made and lost one by one.
constexpr int kContactsAnIteration = 20;
constexpr int kMostPatience = 60;
constexpr double kProgress = 0.9;

// A step is solved again at most this often, because friction limits moved with the normal forces by
// more than the share [-] given, or pairs were missed. Fewer: such changes lag by a step. Larger share: what
// slides is off by as much, and rounding decides by how much.
constexpr int kRounds = 8;

// Residual over the forces at hand under which it is seen to that before the solution is exact, and over what
// the last round began with [-]. Larger: limits and depths are wild, and rounds are used up by that. Smaller:
// each round is solved to an accuracy that the next one throws away.
constexpr double kLooseRound = 3e-3;
constexpr double kNextRound = 0.5;

class Progress {
 public:
  explicit Progress(size_t contacts)
      : patience_(
            std::min(kMostPatience, kMixedIterations + static_cast<int>(contacts) / kContactsAnIteration)) {}

  // After an iteration that left this residual. true: patience is at an end.
  bool stalled(double residual) {
    ++idle_;
    if (residual < kProgress * best_) best_ = residual, idle_ = 0;
    return idle_ > patience_;
  }

 private:
  int patience_, idle_ = 0;
  double best_ = std::numeric_limits<double>::infinity();
};

// Rounds of a Newton solution (solver/newton.cpp): what follows the solution, friction limits, the stiffness
// of what is too deep, and pairs that were missed, stands still within a round, so that each minimises a
// fixed potential.

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
  bool next(Island& island, int iteration, double enough);

 private:
  int count_ = 0, begun_ = 0;
  double loose_ = kLooseRound;
  bool fresh_ = false;  // what it begins with is not known yet
};

// Ways to go on (solver/globalisation.cpp): by that share of the step.
void advance(Island& island, double alpha);
// Along a direction of descent, to where the slope of the step's potential has at least halved.
void line_search(Island& island);
// From the state that is known to be finite.
void restart_from_now(Island& island);

}  // namespace bt
