// What is left of a Newton solution (newton.cpp) in a few places.
//
// Among many contacts some are found late, each in a place of its own, while all the rest has its solution.
// The particles around those places are solved for by iterations of the same kind, with all others where they
// are: nonlinear elimination (Lanzkron, Rose and Wilkes 1996). What that leaves at the edges, the next
// iteration on all of them takes away. So what a place costs depends on its size, and not on that of the
// heap.
#pragma once
#include "stepping.h"

namespace bt {

class Places {
 public:
  // After a residual, of iterates that are far from their solution. true: it was in a few places, and what is
  // there has been moved (residuals have to be found anew).
  bool solve(Group& group, const StepContext& context);

 private:
  bool find(const Group& group);
  void mark_residuals(const Group& group);
  void widen(const Group& group);
  bool any_near(const Spot& s) const;
  void gather(Group& group);
  bool step(const StepContext& context);
  void iterate(const StepContext& context);
  void hand_back(Group& group);

  Group part_;                // the tendons and rows that have a part in it
  std::vector<char> near_;    // particles that do, by tendon
  std::vector<char> marked_;  // before these are widened
  std::vector<int> first_;    // particle of each tendon, by slot
};

}  // namespace bt
