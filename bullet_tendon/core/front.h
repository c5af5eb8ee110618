// Where in the trees of two tendons (strands.h), or of one, it is told that they cannot touch: pairs of
// strands that together have all segments, each with how far it is apart. For what moves so fast, or so
// differently from place to place, that a search of the whole does not last.
//
// From look to look only the pairs that may have come too near are measured anew, and divided where that is
// not enough (a front through the tree of all pairs: Klosowski et al. 1998; Ehmann and Lin 2001). Most are
// not even asked: as long as the whole has not moved by what they have room for.
#pragma once
#include <vector>

#include "courses.h"

namespace bt {

class Searched;

struct StrandPair {
  int i = 0, j = 0;
  double clear = 0;     // no segments of theirs, but joined ones, were nearer [m]
  Vec3 gone;            // of i less that of j,
  double gone_off = 0;  // and the sum of both, then
  int waits = 0;        // looks for which it is not measured anew
  bool by_arc = false;  // rest lengths matter
};

class Front {
 public:
  void forget() { pairs_.clear(), due_.clear(); }
  // Appends the leaves whose segments may come within `reach` of each other, or farther by what they are
  // foreseen to near, at most `most`.
  void look(Searched& a, Searched& b, double reach, double most, std::vector<StrandPair>& near);

 private:
  friend struct Watch;
  void follow(Searched& a, Searched& b);
  void start(Searched& a, Searched& b);
  std::vector<StrandPair> pairs_, anew_;
  // Of each pair: until the whole has gone so far, and the farthest that it reaches and goes within the step
  // besides, they cannot have touched whatever they do themselves [m].
  std::vector<double> due_;
  double path_ = 0;                // that the whole has gone, but what both do alike, from look to look [m]
  Travel last_;                    // of a less that of b, and the sum of both, at the last look
  size_t built_ = 0;               // how many pairs it was made of
  int rest_a_ = -1, rest_b_ = -1;  // which rest lengths
};

}  // namespace bt
