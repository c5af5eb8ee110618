// A symmetric positive definite sparse matrix of 3x3 blocks and its LDL^T factors, for tendons that touch
// each other: chains of blocks, joined by a few more.
//
// Contract: analyse once for a pattern (nothing is done where it is the one before), then start, add,
// factorise, solve any number of right-hand sides. Blocks are eliminated by least degree, so that long
// free stretches cost what a band costs and only what touches fills in. The order is a function of the
// present pattern alone, never of earlier ones, although one with fewer blocks would fit: a snapshot has no
// factors in it, and a world that goes on from one has to round as the world it was taken of. With pivot D
// and blocks A_a below
//
//   W_a = A_a D^-1,   A_ba -= W_b A_a^T,   L_a = W_a.
#pragma once
#include <utility>
#include <vector>

#include "linear/minimum_degree.h"
#include "math/sym3.h"

namespace bt {

struct Block3 {
  double v[9];  // row-major
};
Block3 block_of(const Sym3& s);
Block3 product(const Block3& a, const Block3& b);

// The same in rows of four, of which the last is nothing: whole vector registers.
typedef double Lanes4 __attribute__((vector_size(32), aligned(8)));  // wherever an allocator puts it
struct PaddedBlock {
  Lanes4 row[3];
};

class SparseFactor {
 public:
  using Edges = std::vector<std::pair<int, int>>;
  int blocks() const { return n_; }
  int below() const { return static_cast<int>(rows_.size()); }  // blocks of L
  // n blocks; edges: pairs of different blocks, each listed once or more.
  void analyse(int n, const Edges& edges);
  void start();  // all blocks zero
  // A(i, j) += B, and A(j, i) += B^T.
  void add(int i, int j, const Block3& b);
  // false where a pivot is not positive: the matrix was not definite.
  bool factorise();
  // b becomes A^-1 b.
  void solve(std::vector<Vec3>& b);

 private:
  void find_neighbours();
  void find_columns();
  void plan_updates();
  int slot(int row, int column) const;

  int n_ = 0;
  Edges edges_;
  Adjacency graph_;
  MinimumDegree minimum_degree_;
  std::vector<int> where_, node_;              // place of a block in the elimination, and back
  std::vector<int> first_, rows_;              // places of the blocks below pivot k: rows_[first_[k] ...]
  std::vector<int> child_, sibling_, seen_;    // of the elimination tree, while columns are found
  std::vector<int> target_;                    // block that each update goes to, in order
  std::vector<PaddedBlock> diagonal_, below_;  // D^-1 and L once factorised
  std::vector<PaddedBlock> scaled_;            // W of one pivot, by block below it
  std::vector<Vec3> right_;                    // of a solution, by place
};

}  // namespace bt
