// How far the stretches of a tendon go, each by itself: what its strands (strands.h) do, as travel.h has it
// for all of it.
#pragma once
#include <vector>

#include "chain.h"
#include "strands.h"
#include "travel.h"

namespace bt {

struct Course {
  Travel gone;  // since the first look: sums of what was found from one look to the next
  Travel way;   // as foreseen, in the step
};

class Courses {
 public:
  void look(const Chain& c, const Strands& strands);
  const Course& operator[](int strand) const { return courses_[strand]; }

 private:
  struct Ranges {
    Vec3 low, high, near, far;  // of what was gone, and of what is ahead
  };
  void fit_leaves(const Chain& c);
  Field last_;           // where it was at the last look
  Planes least_, most_;  // of what was gone since then and is ahead, in each leaf
  std::vector<Course> courses_;
  std::vector<Ranges> ranges_;
};

}  // namespace bt
