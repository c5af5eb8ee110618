// A symmetric positive definite sparse matrix of 3x3 blocks and its LDL^T factors, for tendons in contact:
// chains of blocks with a few additional couplings.
//
// Contract: analyse once for a pattern (the same pattern again costs nothing), then start, add, factorise,
// solve any number of right-hand sides. Blocks are eliminated in minimum-degree order. Long stretches without
// contact therefore cost as much as a band, and only contacts cause fill-in. The order is a function of the
// present pattern only, never of an earlier pattern, even if that one includes all present blocks. The
// reason: a snapshot has no factors, and a world that continues from a snapshot has to round like the
// original world. With pivot D and blocks A_a below
//
//   W_a = A_a D^-1,   A_ba -= W_b A_a^T,   L_a = W_a.
#pragma once
#include <utility>
#include <vector>

#include "linear/block_columns.h"
#include "math/mat3.h"

namespace bt {

// A block in rows of four numbers, the last of which is 0: whole vector registers.
typedef double Lanes4 __attribute__((vector_size(32), aligned(8)));  // at any address
struct PaddedBlock {
  Lanes4 row[3];
};

class SparseFactor {
 public:
  using Edges = std::vector<std::pair<int, int>>;
  int blocks() const { return n_; }
  int below() const { return static_cast<int>(rows_.size()); }  // number of blocks of L
  // n blocks; edges: pairs of different blocks, each listed at least once.
  void analyse(int n, const Edges& edges);
  void start();  // all blocks zero
  // A(i, j) += B, and A(j, i) += B^T.
  void add(int i, int j, const Mat3& b);
  // false: a pivot is not positive, so the matrix is not positive definite. Its factors, which solve with it
  // all the same, are complete only if `through`.
  bool factorise(bool through = false);
  // b becomes A^-1 b.
  void solve(std::vector<Vec3>& b);
  // b becomes L^-T min(D^-1, 0) L^-1 b, with the negative eigenvalues of the blocks D^-1: a direction of
  // negative curvature, or 0.
  void solve_negative(std::vector<Vec3>& b);
  // The same as solve for eight right-hand sides at once, with the same bits in each lane.
  void solve(Columns& b);

 private:
  void list_neighbours();
  void join_neighbours(int i, int pivot);
  void eliminate_symbolically();
  void plan_updates();
  int slot(int row, int column) const;
  // b becomes L^-T pivot(D^-1, L^-1 b).
  template <class Pivot>
  void substitute(std::vector<Vec3>& b, Pivot pivot);

  int n_ = 0;
  Edges edges_;
  std::vector<std::vector<int>> neighbours_;  // of each block when it is eliminated
  std::vector<int> marked_;                   // by block: the last mark that it got
  int mark_ = 0;
  std::vector<int> where_, node_;  // position of a block in the elimination order, and the inverse
  std::vector<int> first_, rows_;  // positions of the blocks below pivot k: rows_[first_[k] ...]
  std::vector<int> target_;        // target block of each update, in order
  std::vector<PaddedBlock> diagonal_, below_;  // D^-1 and L once factorised
  std::vector<PaddedBlock> scaled_;            // W of one pivot, by block below it
  std::vector<Vec3> right_;                    // of a solution, by position
  Columns columns_;                            // of eight solutions, by position
};

}  // namespace bt
