// What is solved at once: tendons that touch each other or move the same bodies.
#pragma once
#include <vector>

#include "bodies/link.h"
#include "contact/contact.h"
#include "linear/sparse_block_ldlt.h"
#include "solver/body_border.h"
#include "tendon/tendon.h"

namespace bt {

// Bodies whose coordinates are unknowns of the solution (solver/body_schur.cpp).
struct IslandBodies {
  std::vector<GeneralizedBody>* all = nullptr;  // of the world
  std::vector<Link>* links = nullptr;           // of the world
  std::vector<int> indices;                     // of the bodies that are unknown
  std::vector<int> carried;                     // links of theirs
  int freedom = 0;                              // number of unknowns
  double reach = 0;                             // s of bodies/body_response.h [s]
  // By unknown: its columns of the border, by tendon; where in the island a tendon is, by slot; and what the
  // unknowns make of links.
  std::vector<Border> borders;
  std::vector<int> place_of;
  std::vector<LinkColumns> of_links;
  // The Schur complement, its factor, and its right-hand side, then solution.
  dense::Numbers corner, corner_root, corner_side;
};

// The matrix of tendons that touch each other (solver/linear_solve.cpp).
struct IslandMatrix {
  SparseFactor factor;
  SparseFactor::Edges edges;
  std::vector<int> offset;  // where a tendon's particles begin, by slot
  bool patterned = false;   // the pattern is of this island
  std::vector<Sym3> free;   // by block, what anchors leave free
  std::vector<Vec3> right_hand;
  double tolerance = 0;  // that this solution can make use of; 0: that of the options
};

struct IslandResult {
  int iterations = 0;
  double residual = 0;  // largest residual force over the largest force at hand
  bool converged = false;
  bool left_predicted_region = false;  // the solution was left for that
  bool finite = true;
};

// Tendons joined by contacts or bodies, with the contacts that touch them. It refers to the world's tendons,
// contacts and bodies, and is made anew for each solution.
struct Island {
  const std::vector<Tendon*>* slots = nullptr;  // all tendons of the world, as segment points name them
  std::vector<Tendon*> tendons;
  std::vector<int> numbers;  // of their slots
  std::vector<Contact*> contacts;
  std::vector<Contact*> acting;  // in the matrix that is being made
  bool coupled = false;          // some contact joins two tendons, or two places of one
  bool follows = true;           // points of contacts move along with what they touch
  IslandBodies bodies;
  IslandMatrix matrix;
  IslandResult result;

  Tendon& at(const SegmentPoint& s) const { return *(*slots)[s.tendon]; }
};

using Which = Field Tendon::*;

}  // namespace bt
