// What is solved at once: tendons that touch each other or move the same bodies.
#pragma once
#include <vector>

#include "bodies/link.h"
#include "contact/contact.h"
#include "linear/sparse_block_ldlt.h"
#include "solver/body_border.h"
#include "tendon/tendon.h"

namespace bt {

// Two points that act on each other: by a spring, or by a contact, of a tendon (b.chain = -1: with a link).
struct Push {
  Spot a, b;
  Vec3 along;       // unit, from b to a
  Vec3 of_link;     // velocity of the link there [m/s]
  double made = 0;  // energy that it made out of nothing [J]
  Row* row = nullptr;
  double light = 0;  // inverse mass that an impulse between them meets [1/kg]
};

// Tendons joined by tendon-tendon contacts, with the rows that touch them.
struct Group {
  const std::vector<Chain*>* slots = nullptr;  // all tendons of the world, as spots name them
  std::vector<Chain*> chains;
  std::vector<int> numbers;  // of their slots
  std::vector<Row*> rows;
  // Bodies that are unknown, the links of them that are touched, and how many unknowns that makes
  // (solver/body_schur.cpp).
  std::vector<Mover>* movers = nullptr;
  std::vector<Link>* links = nullptr;
  std::vector<int> bodies, carried;
  int freedom = 0;
  double reach = 0;        // s of bodies/body_response.h [s]
  std::vector<Row> extra;  // found while solving; kMostExtraRows at most, so that pointers stay
  bool coupled = false;    // some row joins two tendons, or two places of one
  // Of the matrix of tendons that touch each other (solver/linear_solve.cpp): the factors and the pattern,
  // where each tendon's particles begin, by slot, and by block what holds leave free and the right-hand side.
  SparseFactor factor;
  SparseFactor::Edges edges;
  std::vector<int> offset;
  bool patterned = false;    // the pattern is of this group
  std::vector<Row*> acting;  // in the matrix that is being made
  bool follows = true;       // points of rows move along with what they touch,
  double most_jump = 0;      // but for pairs whose force that would change by more than this [N],
  bool stayed = false;       // of which there are some that have not been looked at
  std::vector<Sym3> free;
  std::vector<Vec3> right_hand;
  int iterations = 0;
  double residual = 0;  // largest residual force over the largest force at hand
  bool converged = false;
  bool strays = false;  // left, for that
  bool finite = true;
  double linear_tolerance = 0;  // that this solution can make use of; 0: that of the options
  // By unknown of the bodies: what they pull at the tendons, by tendon, where in the group that is, by slot,
  // and what they make of links (solver/body_schur.cpp); the matrix and right-hand side of the rest.
  std::vector<Border> borders;
  std::vector<int> place_of;
  std::vector<LinkColumns> of_links;
  dense::Numbers corner, corner_root, corner_side;

  std::vector<Push> pushes;  // of solver/energy_projection.cpp

  Chain& at(const Spot& s) const { return *(*slots)[s.chain]; }
};

using Which = Field Chain::*;

}  // namespace bt
