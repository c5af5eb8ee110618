// Stretches of a tendon in a tree, each bounded by its chord and how far it leaves that: line swept spheres
// (Larsen, Gottschalk, Lin, Manocha 2000), here around a polyline.
//
// All of a stretch is within `radius` of its chord. A child's chord ends on its parent's, but where both
// children meet, h away: so the parent's radius is h more than the greater of theirs. Its segments go along
// `heading`, or off it by an angle of cosine `straight`: two of its points, an arc s apart, are at least
// `straight` s apart.
#pragma once
#include <vector>

#include "chain.h"

namespace bt {

struct Strand {
  Vec3 a, b;                // the chord
  double radius = 0;        // [m]
  int first = 0, last = 0;  // segments; last is not one of them
  int second = -1;          // the other child, the first being the next strand; -1: a leaf
  Vec3 heading;
  double straight = 1;
  double stretch = 1;  // least length of its segments over that at rest
};

class Strands {
 public:
  // A tree for so many segments; nothing of it is where the tendon is.
  void look(int segments);
  int size() const { return static_cast<int>(strands_.size()); }
  // Where it is; it has to have been fitted since the last look.
  const Strand& operator[](int at) const { return strands_[at]; }
  const Strand& fit(const Chain& c, int at);
  void fit_all(const Chain& c) { fit(c, 0); }

 private:
  int build(int first, int last);
  void fit_leaf(const Chain& c, Strand& leaf) const;
  void join(Strand& strand, const Strand& p, const Strand& q) const;
  std::vector<Strand> strands_;
  std::vector<char> fitted_;
};

// The cosine of the cone around both, and its axis.
double straightness_of_both(const Strand& p, const Strand& q, Vec3& heading);
// How many leaves so many segments have.
int leaves_of(int segments);
// Of two strands that are not both leaves: whether the first is divided, or the second.
bool divides_first(const Strand& p, const Strand& q);
// Between two chords, and two segments.
double between(const Strand& p, const Strand& q);
double between_segments(const Field& x, int k, const Field& y, int m);

}  // namespace bt
