// The border of the tendons' matrix: columns of the bodies' unknowns, in panels of eight.
#pragma once
#include <vector>

#include "linear/block_columns.h"

namespace bt {

// Eight columns of the border, for one tendon.
struct Panel {
  Columns pulls;            // C: derivatives of the residual of its particles by the unknowns
  Columns answers;          // A^-1 C
  Columns moves;            // derivatives of the displacements of its carried particles (attached to bodies)
  std::vector<int> pulled;  // blocks outside which pulls and moves are zero
  bool moved = false;       // moves are not zero
};

// All columns, for one tendon. Pulls and moves are zero in all blocks but `pulled`, which lie between first
// and last.
struct Border {
  std::vector<Panel> panels;
  std::vector<int> pulled;
  std::vector<char> marks;  // by block: whether it is in `pulled`
  int first = 0, last = -1;
  bool carried = false;  // some of its particles are carried by bodies
};

// Derivatives of the twist of a link by eight unknowns, and of the load on it.
struct LinkColumns {
  Eight twist[6], load[6];
  bool moves = false;  // twist is not zero
};

}  // namespace bt
