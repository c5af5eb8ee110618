// An island: tendons, bodies and contacts that are solved together.
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
  std::vector<int> indices;                     // of the bodies with unknowns
  std::vector<int> carried;                     // links of these bodies
  int freedom = 0;                              // number of unknowns
  double reach = 0;                             // s of bodies/body_response.h [s]
  // By tendon of the island: its border. By slot: the index of the tendon in the island. By link: its
  // columns.
  std::vector<Border> borders;
  std::vector<int> place_of;
  std::vector<LinkColumns> of_links;
  // The Schur complement (freedom x freedom), its Cholesky factor, and its right-hand side, later the
  // solution (freedom).
  dense::Numbers corner, corner_root, corner_side;
};

// The matrix of tendons that touch each other (solver/linear_solve.cpp).
struct IslandMatrix {
  SparseFactor factor;
  SparseFactor::Edges edges;
  std::vector<int> offset;  // first block of a tendon, by slot; -1: not in the island
  bool patterned = false;   // the pattern is that of this island
  std::vector<Sym3> free;   // by block: projector on the directions that are not constrained
  std::vector<Vec3> right_hand;
  double tolerance = 0;  // sufficient relative tolerance of this solution [-]; 0: that of the options
};

struct IslandResult {
  int iterations = 0;
  double residual = 0;  // largest residual force over the largest force [-]
  bool converged = false;
  bool left_predicted_region = false;  // the solution ended for this reason
  bool finite = true;
};

// Tendons joined by contacts or bodies, with their contacts. It refers to tendons, contacts and bodies of the
// world, and is created for each solution.
struct Island {
  const std::vector<Tendon*>* slots =
      nullptr;  // all tendons of the world; SegmentPoint::tendon is an index of this
  std::vector<Tendon*> tendons;
  std::vector<int> numbers;  // slots of these tendons
  std::vector<Contact*> contacts;
  std::vector<Contact*> acting;  // those in the present matrix
  bool coupled = false;          // some contact joins two tendons, or two segments of one
  bool follows = true;           // contact points move to the nearest points
  IslandBodies bodies;
  IslandMatrix matrix;
  IslandResult result;

  Tendon& at(const SegmentPoint& s) const { return *(*slots)[s.tendon]; }
};

using Which = Field Tendon::*;

}  // namespace bt
