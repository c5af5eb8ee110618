// An island: tendons, bodies and contacts that are solved together.
#pragma once
#include <array>
#include <vector>

#include "bodies/link.h"
#include "contact/contact.h"
#include "element/element.h"
#include "linear/block_columns.h"
#include "linear/sparse_block_ldlt.h"
#include "tendon/tendon.h"

namespace bt {

// The border of the tendons' matrix has one column for each unknown of the bodies, in panels of eight. A
// Panel is eight columns, for one tendon.
struct Panel {
  Columns pulls;            // C: derivatives of the residual of its particles by the unknowns
  Columns answers;          // A^-1 C
  Columns moves;            // derivatives of the displacements of its carried particles (attached to bodies)
  std::vector<int> pulled;  // blocks outside which pulls and moves are zero
  // Whether pulls or moves are not zero, and whether answers are known: else they are zero.
  bool pulls_any = false, moves_any = false, answered = false;
};

// All columns, for one tendon. Pulls and moves are zero in all blocks but `pulled`, which lie between first
// and last.
struct Border {
  std::vector<Panel> panels;
  std::vector<int> pulled;
  std::vector<char> marks;  // by block: whether it is in `pulled`, and whether it is carried (Mark)
  int first = 0, last = -1;
  bool carried = false;  // some of its particles are carried by bodies
};

// What the unknowns of a panel act on. The columns of all other tendons are zero.
struct PanelReach {
  std::vector<int> moved;    // links of its bodies
  std::vector<int> tendons;  // of the island: those that `moved` carry, pull or touch, and what touches these
  std::vector<int> links;    // `moved`, and those on which these tendons act
  std::vector<int> contacts;  // acting ones, of these tendons
};

// Derivatives of the twist of a link by eight unknowns, and of the load on it.
struct LinkColumns {
  Eight twist[6], load[6];
  bool moves = false, loaded = false;  // twist, or load, is not zero
};

// The second derivatives of the potential of a contact, by the displacements of what it acts on: of both
// particles of its segment a, and of those of b, or of its link: of the centre of mass and, about it, the
// rotation. On a link that does not move only the first two are set.
struct ContactMatrix {
  Mat3 blocks[10];
  // i <= j. The others are their transposes.
  Mat3& at(int i, int j) { return blocks[j * (j + 1) / 2 + i]; }
  const Mat3& at(int i, int j) const { return blocks[j * (j + 1) / 2 + i]; }
};

// Bodies whose coordinates are unknowns of the solution (solver/body_schur.cpp).
struct IslandBodies {
  std::vector<GeneralizedBody>* all = nullptr;  // of the world
  std::vector<Link>* links = nullptr;           // of the world
  std::vector<int> indices;                     // of the bodies with unknowns
  std::vector<int> carried;                     // links of these bodies
  int freedom = 0;                              // number of unknowns
  double reach = 0;                             // s of bodies/body_response.h [s]
  // Whether all surfaces of contacts turn with the bodies in the matrix. In a step, most stay as detected.
  bool turn_surfaces = false;
  // By tendon of the island: its border. By slot: the index of the tendon in the island. By link: its
  // columns.
  std::vector<Border> borders;
  std::vector<PanelReach> reaches;  // by panel
  std::vector<int> place_of;
  std::vector<LinkColumns> of_links;
  std::vector<ContactMatrix> link_blocks;  // sums of the contacts' blocks, by link
  // The Schur complement (freedom x freedom), its Cholesky factor, and its right-hand side, later the
  // solution (freedom).
  dense::Numbers corner, corner_root, corner_side;

  GeneralizedBody& body(int slot) const { return (*all)[slot]; }
  Link& link(int slot) const { return (*links)[slot]; }
};

// Elements between the links of the bodies (solver/element_coupling.h).
struct IslandElements {
  std::vector<Element*> all;
  std::vector<int> links;                  // slots that they touch
  std::vector<LinkPair>* pairs = nullptr;  // of the world
  std::vector<LinkEnd>* ends = nullptr;    // of the world, by link slot
  std::vector<int> own_pairs;              // indices of the pairs that they touch
  // Of each own pair, what Element::add_curvature adds at an earlier iterate of this solution. Empty:
  // nothing.
  std::vector<std::array<double, 36>> curvature;
  dense::Scratch half, block;
  double dt = 0, time = 0;  // length of the substep, and its end from the start of the step [s]
};

// The matrix of tendons that touch each other (solver/linear_solve.cpp).
struct IslandMatrix {
  SparseFactor factor;
  SparseFactor::Edges edges;
  std::vector<int> offset;  // first block of a tendon, by slot; -1: not in the island
  bool patterned = false;   // the pattern is that of this island
  std::vector<Sym3> free;   // by block: projector on the directions that are not constrained
  std::vector<Vec3> right_hand;
  Columns right_hands;   // eight of them
  double tolerance = 0;  // sufficient relative tolerance of this solution [-]; 0: that of the options
};

struct IslandResult {
  int iterations = 0;
  double residual = 0;  // largest residual force over the largest force [-]
  bool converged = true;
  bool left_predicted_region = false;  // the solution ended for this reason
  bool overpowered = false;            // so did the stiffening of contacts: what holds a body gives less
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
  std::vector<Contact*> acting;            // those in the present matrix
  std::vector<ContactMatrix> of_contacts;  // their parts of it
  bool coupled = false;                    // some contact joins two tendons, or two segments of one
  bool curved = false;                     // the present step has a correction (solver/arc.cpp)
  IslandBodies bodies;
  IslandElements elements;
  IslandMatrix matrix;
  IslandResult result;

  Tendon& at(const SegmentPoint& s) const { return *(*slots)[s.tendon]; }
  bool is_empty() const { return tendons.empty() && elements.all.empty(); }
  void clear() {
    tendons.clear();
    numbers.clear();
    contacts.clear();
    bodies.indices.clear();
    bodies.carried.clear();
    elements.all.clear();
  }
};

using Which = Field Tendon::*;

}  // namespace bt
