// A massless element that acts on links: a ligament, or cartilage between two links.
//
// An element has no unknowns of its own. With its potential U of the places of links at the end of the
// substep, it adds to the unknowns y of the bodies (solver/body_schur.cpp)
//
//   the gradient    sum B^T (dU/d twist),      the Hessian    sum B^T (d2U/d twist2) B,
//
// where the twist of a link moves the point at the arm r, as it is at the iterate, by linear + angular x r.
// The same arms give the wrench on the link. The change of the arms with the rotation is added by
// FiniteRotation (bodies/finite_rotation.h), from the products r f that an element sums for each link.
#pragma once
#include <array>
#include <vector>

#include "bodies/link.h"

namespace bt {

// Second derivative of a potential by the twists of two links: 6 x 6, by rows of the first.
struct LinkPair {
  int one = -1, other = -1;  // slots of the links, one <= other
  std::array<double, 36> stiffness{};
};

// A link that an element touches, and the element's wrench on it.
struct TouchedLink {
  int link = -1;       // slot
  Vec3 lever;          // one of the longest arms, at the start of the substep [m]
  Vec3 force, torque;  // about its centre of mass, with the arms at the end of the substep [N], [N m]
  Mat3 pulls;          // sum of outer products r f
  void clear() {
    force = torque = {};
    pulls = {};
  }
  // Adds a force at the arm [N].
  void add(Vec3 arm, Vec3 f);
};

class Element {
 public:
  virtual ~Element() = default;
  const std::vector<TouchedLink>& touched() const { return touched_; }
  // Index of the pair of touched links i <= j among all pairs of the world (ElementSet).
  int pair(int i, int j) const { return pairs_[i * static_cast<int>(touched_.size()) + j]; }

  // Begins a substep of h [s] from the present poses of the links.
  virtual void begin(const std::vector<Link>& links, double h) = 0;
  // Computes forces and potential where the links end. ends: by slot.
  virtual void evaluate(const std::vector<LinkEnd>& ends) = 0;
  // Adds the second derivatives at the last evaluation. definite: only positive semidefinite terms.
  virtual void add_stiffness(std::vector<LinkPair>& pairs, bool definite) const = 0;
  // Adds what add_stiffness(pairs, false) leaves out of the second derivatives. It may be indefinite.
  virtual void add_curvature(std::vector<LinkPair>& pairs) const = 0;
  // Makes the last evaluation the state.
  virtual void accept() = 0;

  double largest_force() const { return largest_; }       // [N]
  double largest_stiffness() const { return stiffest_; }  // [N/m]
  double potential() const { return potential_; }         // [J]

 protected:
  explicit Element(const std::vector<int>& links);
  std::vector<TouchedLink> touched_;
  double largest_ = 0, stiffest_ = 0, potential_ = 0;

 private:
  friend class PairList;
  std::vector<int> pairs_;
};

// The pairs of links that elements touch together. Each pair is listed once, whatever the number of elements.
class PairList {
 public:
  std::vector<LinkPair> all;
  // Lists the pairs of an element.
  void include(Element& element);

 private:
  int find(int one, int other);
};

// stiffness += weight a b^T, for vectors of six numbers.
inline void add_outer(LinkPair& pair, double weight, const double* a, const double* b) {
  for (int i = 0; i < 6; ++i) {
    const double w = weight * a[i];
    for (int j = 0; j < 6; ++j) pair.stiffness[6 * i + j] += w * b[j];
  }
}

}  // namespace bt
