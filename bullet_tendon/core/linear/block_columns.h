// Eight right-hand sides side by side, one in each lane of a vector.
#pragma once
#include <algorithm>
#include <vector>

#include "math/simd.h"

namespace bt {

// Eight columns for the blocks of a tendon: three vectors of eight numbers per block, one for each axis. An
// additional block of zeros follows the last one, for a SegmentPoint (contact/segment_point.h) whose `first`
// is the last particle.
class Columns {
 public:
  void resize(int blocks) { data_.assign(size_of(blocks), 0.0); }
  bool empty() const { return data_.empty(); }
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

}  // namespace bt
