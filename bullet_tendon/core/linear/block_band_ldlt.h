// A symmetric positive definite block-banded matrix of 3x3 blocks, its LDL^T factors and products.
//
// Contract: `half` is 1 or 2 (blocks below the diagonal), n >= 2 blocks. Fill diagonal and below, factorise,
// solve any number of right-hand sides. Nothing is allocated after resize.
//
// The elimination proceeds from both ends towards the middle, in the two lanes of one vector register: block
// s in lane 0 and block n-1-s in lane 1 do the same arithmetic. The remaining 1 to 3 blocks in the middle are
// solved densely. With A(i+1,i) = E1, A(i+2,i) = E2 one pivot does
//
//   D = L diag L^T,  Z1 = D^-1 E1^T,  Z2 = D^-1 E2^T
//   A(i+1,i+1) -= E1 Z1,   A(i+2,i+1) -= E2 Z1,   A(i+2,i+2) -= E2 Z2.
#pragma once
#include <vector>

#include "linear/block_columns.h"
#include "math/mat3.h"
#include "math/soa_field.h"

namespace bt {

typedef double Lanes __attribute__((vector_size(16)));  // lane 0: from the top, lane 1: from the bottom

// Blocks that are stored by entry: symmetric ones in six planes, others in nine.
Sym3 symmetric_at(const Planes& planes, int i);
void set(Planes& planes, int i, const Sym3& b);
Mat3 block_at(const Planes& planes, int i);
void set(Planes& planes, int i, const Mat3& b);

struct Band {
  int n = 0, half = 1;
  Planes diagonal;  // six planes, symmetric blocks A(i,i)
  Planes below[2];  // nine planes, row-major blocks A(i+1,i) and A(i+2,i), at column i

  void resize(int blocks, int half_bandwidth);
  void zero();
  void add(int i, const Sym3& b);
  // A(i+offset, i) += b, offset 1 or 2.
  void add_below(int i, const Mat3& b, int offset = 1);
  // y = A x.
  void multiply(const Field& x, Field& y) const;
  // Projects the rows and columns of block i by P = I - N, and adds N to the diagonal block, so that the
  // matrix remains definite (Baraff and Witkin 1998, the filter). N = I: the block is fixed; N = n n^T: it is
  // fixed along n.
  void hold(int i, const Sym3& N);
};

class BandFactor {
 public:
  void resize(int blocks, int half_bandwidth);
  // false: a pivot is not positive, so the matrix is not positive definite.
  bool factorise(const Band& a);
  // x = A^-1 b; x and b may be the same.
  void solve(const Field& b, Field& x) const;
  // x = L^-T min(D^-1, 0) L^-1 b, so that x^T A x is the sum of y^2/D over the negative pivots D, with y =
  // L^-1 b: it is negative, or x is 0 because no pivot is.
  void solve_negative(const Field& b, Field& x) const;
  // The same for eight right-hand sides, which are zero outside blocks first to last. Only these blocks of x
  // are computed.
  void solve(const Columns& b, int first, int last, Columns& x) const;

 private:
  template <int H>
  bool factorise_ends(const Band& a);
  template <int H, bool Negative>
  void solve_ends(const Field& b, Field& x) const;
  // The passes for eight columns.
  template <int H>
  void columns_ends(int first, int last, Columns& x) const;
  template <int H, int Lane, class At>
  void columns_inwards(int from, At at, Eight* next, Eight* after) const;
  template <int H, int Lane, class At>
  void columns_outwards(int to, At at) const;
  bool factorise_middle(const Band& a);
  // Solves for the middle, for Width right-hand sides: y has 3 middle_ rows of Width numbers. Negative: with
  // the negative pivots alone.
  template <int Width, bool Negative>
  void solve_middle(double* y) const;

  struct Pivot {
    Lanes ldl[6];   // l21 l31 l32, 1/d1 1/d2 1/d3
    Lanes z[2][9];  // Z1, Z2, row-major
  };
  int n_ = 0, half_ = 1, steps_ = 0, middle_ = 0;
  std::vector<Pivot> pivots_;
  Lanes left_[3][9];  // updates of the middle by the ends: of the first and second block, and between them
  double dense_[81];  // factors of the middle: unit lower triangle and inverse diagonal, rows of 9
};

template <int Width, bool Negative>
BT_WITHIN inline void BandFactor::solve_middle(double* y) const {
  const int m = 3 * middle_;
  auto take = [&](int i, int j, double share) BT_WITHIN {
    double *to = y + Width * i, *from = y + Width * j;
#pragma GCC ivdep
    for (int k = 0; k < Width; ++k) to[k] -= share * from[k];
  };
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < i; ++j) take(i, j, dense_[9 * i + j]);
  for (int i = 0; i < m; ++i) {
    const double inverse = dense_[9 * i + i], kept = Negative && !(inverse < 0) ? 0 : inverse;
    for (int k = 0; k < Width; ++k) y[Width * i + k] *= kept;
  }
  for (int i = m - 1; i >= 0; --i)
    for (int j = i + 1; j < m; ++j) take(i, j, dense_[9 * j + i]);
}

}  // namespace bt
