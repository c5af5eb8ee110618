// Eight columns at once, one in each lane of a vector: what eight unknowns of bodies pull at a tendon.
#pragma once
#include <vector>

#include "field.h"

namespace bt {

constexpr int kLanes = 8;
typedef double Eight __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));

// Columns of a tendon's blocks: three vectors by block, for its axes; and one block that is nothing, which
// the spot of a last particle has beside it (row.h).
class Columns {
 public:
  void resize(int blocks) { data_.assign(size_of(blocks), 0.0); }
  bool fits(int blocks) const { return data_.size() == size_of(blocks); }
  // Blocks first to last.
  void zero(int first, int last) {
    if (first <= last) std::fill(number(first), number(last + 1), 0.0);
  }
  double* number(int block) { return data_.data() + static_cast<size_t>(3) * kLanes * block; }
  Eight* at(int block) { return reinterpret_cast<Eight*>(number(block)); }
  const Eight* at(int block) const {
    return reinterpret_cast<const Eight*>(data_.data() + static_cast<size_t>(3) * kLanes * block);
  }

 private:
  static size_t size_of(int blocks) { return static_cast<size_t>(3) * kLanes * (blocks + 1); }
  std::vector<double> data_;
};

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
