// What is solved at once: tendons that touch each other or move the same bodies.
#pragma once
#include <vector>

#include "bodies/link.h"
#include "contact/contact.h"
#include "linear/sparse_block_ldlt.h"
#include "solver/body_border.h"
#include "tendon/tendon.h"

namespace bt {

// Tendons joined by tendon-tendon contacts, with the contacts that touch them.
struct Island {
  const std::vector<Tendon*>* slots = nullptr;  // all tendons of the world, as spots name them
  std::vector<Tendon*> tendons;
  std::vector<int> numbers;  // of their slots
  std::vector<Contact*> contacts;
  // Bodies that are unknown, the links of them that are touched, and how many unknowns that makes
  // (solver/body_schur.cpp).
  std::vector<GeneralizedBody>* all_bodies = nullptr;
  std::vector<Link>* links = nullptr;
  std::vector<int> bodies, carried;
  int freedom = 0;
  double reach = 0;      // s of bodies/body_response.h [s]
  bool coupled = false;  // some contact joins two tendons, or two places of one
  // Of the matrix of tendons that touch each other (solver/linear_solve.cpp): the factors and the pattern,
  // where each tendon's particles begin, by slot, and by block what holds leave free and the right-hand side.
  SparseFactor factor;
  SparseFactor::Edges edges;
  std::vector<int> offset;
  bool patterned = false;        // the pattern is of this island
  std::vector<Contact*> acting;  // in the matrix that is being made
  bool follows = true;           // points of contacts move along with what they touch
  std::vector<Sym3> free;
  std::vector<Vec3> right_hand;
  int iterations = 0;
  double residual = 0;  // largest residual force over the largest force at hand
  bool converged = false;
  bool left_predicted_region = false;  // left, for that
  bool finite = true;
  double linear_tolerance = 0;  // that this solution can make use of; 0: that of the options
  // By unknown of the bodies: what they pull at the tendons, by tendon, where in the island that is, by slot,
  // and what they make of links (solver/body_schur.cpp); the matrix and right-hand side of the rest.
  std::vector<Border> borders;
  std::vector<int> place_of;
  std::vector<LinkColumns> of_links;
  dense::Numbers corner, corner_root, corner_side;

  Tendon& at(const SegmentPoint& s) const { return *(*slots)[s.tendon]; }
};

using Which = Field Tendon::*;

}  // namespace bt
