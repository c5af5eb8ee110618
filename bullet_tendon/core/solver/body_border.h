// The border that unknowns of bodies put around the tendons' matrix: eight columns at once.
#pragma once
#include <vector>

#include "linear/block_columns.h"

namespace bt {

// Eight unknowns' columns of one tendon.
struct Panel {
  Columns pulls;            // at its particles, and
  Columns answers;          // A^-1 of that
  Columns moves;            // of the particles that bodies carry, of which there may be some
  std::vector<int> pulled;  // outside of these blocks pulls and moves are nothing
  bool moved = false;       // moves are other than nothing
};

// Those of all unknowns, for one tendon. Outside of the blocks first to last there is nothing, nor between
// them but in `pulled`.
struct Border {
  std::vector<Panel> panels;
  std::vector<int> pulled;
  std::vector<char> marks;  // by block: it is pulled
  int first = 0, last = -1;
  bool carried = false;  // bodies carry particles of it
};

// What eight unknowns make of a link's place, and the loads on it.
struct LinkColumns {
  Eight twist[6], load[6];
  bool moves = false;  // twist is other than zero
};

}  // namespace bt
