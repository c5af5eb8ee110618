// Whether any two of many tendons can have come near each other: one comparison for each of them.
//
// Where every pair is clear, what it has room for is shared out: each tendon may do its part of that, besides
// what all of them do alike. As long as none has done more, no pair has to be asked.
#pragma once
#include <vector>

#include "search.h"

namespace bt {

class Crowd {
 public:
  // None of them, neither with another nor with itself.
  bool stays_clear(const std::vector<Searched>& tendons);
  // All pairs are clear now. searches: by slot_of.
  void share(const std::vector<Searched>& tendons, const std::vector<PairSearch>& searches);
  void forget() { parts_.clear(); }

 private:
  struct Part {
    Vec3 gone;
    double gone_off = 0, has = 0, most = 0;  // [m]; has: done by then
    int rest_set = 0;
  };
  // Besides what is common: how far it reaches in the step, and what it has moved since.
  double done(const Searched& tendon, const Part& part) const;
  void find_common(const std::vector<Searched>& tendons);
  std::vector<Part> parts_;   // empty: nothing is shared out
  Vec3 way_, gone_;           // of all
  int looks_ = 0;             // since
  int waits_ = 0, wait_ = 0;  // as of pairs (search.h)
};

}  // namespace bt
