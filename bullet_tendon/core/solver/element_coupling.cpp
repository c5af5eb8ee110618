// Elements in an island's solution: their loads on bodies and their part of the matrix.
//
// An element has a potential of the places where links end (element/element.h). For the unknowns y of the
// bodies of the links one and other,
//
//   r_y += sum B^T (dU/d twist),     D += sum B_one^T (d2U/d twist_one d twist_other) B_other,
//
// with B = s J E of the link as it is at the iterate (solver/body_schur.cpp). The second derivatives of all
// elements between the same two links are added up before they are multiplied by B, once for each pair of
// links. Links of elements turn by finite rotations (bodies/finite_rotation.h): their arms, their loads and
// the change of the loads with the rotation are those of the iterate. Links that nothing moves take part in
// the geometry alone.
//
// The tangent leaves out the curvature of cartilage and of wraps (Gauss-Newton), and converges linearly: each
// iteration leaves a few percent of the residual. The curvature costs as much as a third of an iteration, and
// changes little from one to the next. It is computed once in a solution, near its end (find_curvature). No
// multipliers are carried: a bone that hangs in ligaments has so much inertia over the squared step that
// plain Newton steps converge.
#include <algorithm>
#include <array>
#include <limits>

#include "solver/body_schur.h"

namespace bt {

namespace {

// Whether the link is moved by unknowns of the island.
bool is_moved(const Island& island, const Link& link) {
  return link.yields() && island.bodies.body(link.body).unknowns.any;
}

// block (n x m) = J^T K L, with J (6 n), K (6 6) and L (6 m).
void transform(const dense::Numbers& j, int n, const std::array<double, 36>& k, const dense::Numbers& l,
               int m, dense::Numbers& half, dense::Numbers& block) {
  half.assign(static_cast<size_t>(6) * m, 0.0);
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c)
      for (int b = 0; b < m; ++b) half[r * m + b] += k[6 * r + c] * l[c * m + b];
  block.assign(static_cast<size_t>(n) * m, 0.0);
  for (int r = 0; r < 6; ++r)
    for (int a = 0; a < n; ++a)
      for (int b = 0; b < m; ++b) block[a * m + b] += j[r * n + a] * half[r * m + b];
}

void add_pair(Island& island, const LinkPair& pair, dense::Numbers& half, dense::Numbers& block) {
  const Link &one = island.bodies.link(pair.one), &other = island.bodies.link(pair.other);
  if (!is_moved(island, one) || !is_moved(island, other)) return;
  const GeneralizedBody &a = island.bodies.body(one.body), &b = island.bodies.body(other.body);
  transform(one.iterate.reached, a.n(), pair.stiffness, other.iterate.reached, b.n(), half, block);
  const double square = island.bodies.reach * island.bodies.reach;
  const size_t n = island.bodies.freedom;
  for (int i = 0; i < a.n(); ++i)
    for (int j = 0; j < b.n(); ++j) {
      const double value = square * block[i * b.n() + j];
      island.bodies.corner[(a.unknowns.first + i) * n + b.unknowns.first + j] += value;
      if (pair.one != pair.other)
        island.bodies.corner[(b.unknowns.first + j) * n + a.unknowns.first + i] += value;
    }
}

}  // namespace

void evaluate_elements(IslandElements& elements, const std::vector<Link>& links) {
  for (int l : elements.links) (*elements.ends)[l] = links[l].end(elements.dt, elements.time);
  for (Element* element : elements.all) element->evaluate(*elements.ends);
}

double load_elements(Island& island) {
  if (island.elements.all.empty()) return 0;
  evaluate_elements(island.elements, *island.bodies.links);
  double largest = 0;
  for (const Element* element : island.elements.all) {
    largest = std::max(largest, element->largest_force());
    for (const TouchedLink& touched : element->touched()) {
      Link& link = island.bodies.link(touched.link);
      if (!is_moved(island, link)) continue;
      link.iterate.load.force -= touched.force;
      link.iterate.load.torque -= touched.torque;
      link.iterate.turned.pulls = link.iterate.turned.pulls - touched.pulls;
    }
  }
  return largest;
}

void find_curvature(IslandElements& elements) {
  std::vector<LinkPair>& pairs = *elements.pairs;
  for (int p : elements.own_pairs) pairs[p].stiffness.fill(0);
  for (const Element* element : elements.all) element->add_curvature(pairs);
  for (int p : elements.own_pairs) elements.curvature.push_back(pairs[p].stiffness);
}

void stiffen_by_elements(Island& island, bool definite) {
  if (island.elements.all.empty()) return;
  std::vector<LinkPair>& pairs = *island.elements.pairs;
  std::vector<int>& own = island.elements.own_pairs;
  const auto& curvature = island.elements.curvature;
  for (size_t i = 0; i < own.size(); ++i) {
    std::array<double, 36>& stiffness = pairs[own[i]].stiffness;
    if (definite || curvature.empty())
      stiffness.fill(0);
    else
      stiffness = curvature[i];
  }
  for (const Element* element : island.elements.all) element->add_stiffness(pairs, definite);
  for (int p : own) add_pair(island, pairs[p], island.elements.half, island.elements.block);
}

double element_potential(const Island& island) {
  double sum = 0;
  for (const Element* element : island.elements.all) sum += element->potential();
  return sum;
}

double element_rounding(const Island& island) {
  double stiffest = 0, farthest = 0;
  for (const Element* element : island.elements.all)
    stiffest = std::max(stiffest, element->largest_stiffness() + element->largest_force());
  for (int l : island.elements.links)
    farthest = std::max(farthest, max_abs((*island.elements.ends)[l].centre));
  return std::numeric_limits<double>::epsilon() * stiffest * (1 + farthest);
}

}  // namespace bt
