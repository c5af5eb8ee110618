#include "linear/sparse_block_ldlt.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "math/simd.h"
#include "math/small_matrix.h"

namespace bt {

namespace {

// c = a b
inline void multiply(const PaddedBlock& a, const PaddedBlock& b, PaddedBlock& c) {
  for (int i = 0; i < 3; ++i)
    c.row[i] = a.row[i][0] * b.row[0] + a.row[i][1] * b.row[1] + a.row[i][2] * b.row[2];
}

// c -= a b
inline void subtract_product(const PaddedBlock& a, const PaddedBlock& b, PaddedBlock& c) {
  for (int i = 0; i < 3; ++i)
    c.row[i] -= a.row[i][0] * b.row[0] + a.row[i][1] * b.row[1] + a.row[i][2] * b.row[2];
}

inline PaddedBlock transposed(const PaddedBlock& b) {
  PaddedBlock t;
  for (int i = 0; i < 3; ++i) t.row[i] = Lanes4{b.row[0][i], b.row[1][i], b.row[2][i], 0};
  return t;
}

inline Sym3 symmetric(const PaddedBlock& b) {
  return {b.row[0][0], b.row[0][1], b.row[0][2], b.row[1][1], b.row[1][2], b.row[2][2]};
}

// Returns whether b is positive definite.
inline bool invert(PaddedBlock& b) {
  Sym3 a = symmetric(b);
  const bool definite = invert_definite(a);
  if (!definite) a = inverse(a);
  b = {{Lanes4{a.xx, a.xy, a.xz, 0}, Lanes4{a.xy, a.yy, a.yz, 0}, Lanes4{a.xz, a.yz, a.zz, 0}}};
  return definite;
}

// A set of blocks, one bit each.
class BlockSet {
 public:
  explicit BlockSet(int n) : words_((n + 63) / 64) {}
  void insert(int i) { words_[i / 64] |= bit(i); }
  void erase(int i) { words_[i / 64] &= ~bit(i); }
  // -1: none.
  int first() const {
    for (size_t w = 0; w < words_.size(); ++w)
      if (words_[w]) return static_cast<int>(64 * w) + __builtin_ctzll(words_[w]);
    return -1;
  }

 private:
  static uint64_t bit(int i) { return uint64_t{1} << i % 64; }
  std::vector<uint64_t> words_;
};

// out = a x, and out = a^T x, in each lane.
BT_WITHIN inline void multiply(const PaddedBlock& a, const Eight* x, Eight* out) {
  for (int i = 0; i < 3; ++i) out[i] = a.row[i][0] * x[0] + a.row[i][1] * x[1] + a.row[i][2] * x[2];
}

BT_WITHIN inline void multiply_transposed(const PaddedBlock& a, const Eight* x, Eight* out) {
  for (int i = 0; i < 3; ++i) out[i] = x[0] * a.row[0][i] + x[1] * a.row[1][i] + x[2] * a.row[2][i];
}

BT_WITHIN inline void subtract(Eight* from, const Eight* v) {
  for (int c = 0; c < 3; ++c) from[c] -= v[c];
}

inline Vec3 row_of(const PaddedBlock& b, int i) { return {b.row[i][0], b.row[i][1], b.row[i][2]}; }

inline Vec3 product(const PaddedBlock& b, Vec3 x) {
  return {dot(row_of(b, 0), x), dot(row_of(b, 1), x), dot(row_of(b, 2), x)};
}

}  // namespace

void SparseFactor::analyse(int n, const Edges& edges) {
  if (n == n_ && edges == edges_) return;
  n_ = n;
  edges_ = edges;
  eliminate_symbolically();
  plan_updates();
  diagonal_.resize(n_);
  below_.resize(rows_.size());
}

// Eliminates always the block that has the fewest neighbours (minimum degree), of several the first one. Its
// neighbours are the blocks below its pivot, and become neighbours of each other.
void SparseFactor::eliminate_symbolically() {
  list_neighbours();
  std::vector<BlockSet> of_degree;
  const auto set_of = [&](int i) -> BlockSet& {
    const size_t degree = neighbours_[i].size();
    if (of_degree.size() <= degree) of_degree.resize(degree + 1, BlockSet(n_));
    return of_degree[degree];
  };
  for (int i = 0; i < n_; ++i) set_of(i).insert(i);
  where_.assign(n_, -1);
  node_.clear();
  size_t degree = 0;
  while (static_cast<int>(node_.size()) < n_) {
    const int pivot = of_degree[degree].first();
    if (pivot < 0) {
      ++degree;
      continue;
    }
    of_degree[degree].erase(pivot);
    where_[pivot] = static_cast<int>(node_.size());
    node_.push_back(pivot);
    for (int i : neighbours_[pivot]) {
      set_of(i).erase(i);
      join_neighbours(i, pivot);
      set_of(i).insert(i);
      degree = std::min(degree, neighbours_[i].size());
    }
  }
  first_.assign(1, 0);
  rows_.clear();
  for (int pivot : node_) {
    for (int i : neighbours_[pivot]) rows_.push_back(where_[i]);
    std::sort(rows_.begin() + first_.back(), rows_.end());
    first_.push_back(static_cast<int>(rows_.size()));
  }
}

void SparseFactor::list_neighbours() {
  neighbours_.resize(n_);
  for (std::vector<int>& list : neighbours_) list.clear();
  for (auto [i, j] : edges_) {
    neighbours_[i].push_back(j);
    neighbours_[j].push_back(i);
  }
  for (std::vector<int>& list : neighbours_) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  marked_.assign(n_, 0);
  mark_ = 0;
}

// The neighbours of a pivot become those of its neighbour i, instead of the pivot.
void SparseFactor::join_neighbours(int i, int pivot) {
  std::vector<int>& list = neighbours_[i];
  marked_[i] = ++mark_;
  size_t kept = 0;
  for (int j : list) {
    marked_[j] = mark_;
    if (j != pivot) list[kept++] = j;
  }
  list.resize(kept);
  for (int j : neighbours_[pivot])
    if (marked_[j] != mark_) list.push_back(j);
}

int SparseFactor::slot(int row, int column) const {
  auto from = rows_.begin() + first_[column], to = rows_.begin() + first_[column + 1];
  return static_cast<int>(std::lower_bound(from, to, row) - rows_.begin());
}

// The blocks below row r of pivot k are also below pivot r, in the same order.
void SparseFactor::plan_updates() {
  target_.clear();
  for (int k = 0; k < n_; ++k)
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      target_.push_back(rows_[a]);
      for (int b = a + 1, at = first_[rows_[a]]; b < first_[k + 1]; ++b, ++at) {
        while (rows_[at] != rows_[b]) ++at;
        target_.push_back(at);
      }
    }
}

void SparseFactor::start() {
  std::fill(diagonal_.begin(), diagonal_.end(), PaddedBlock{});
  std::fill(below_.begin(), below_.end(), PaddedBlock{});
}

void SparseFactor::add(int i, int j, const Mat3& b) {
  const int row = where_[i], column = where_[j];
  const bool lower = row >= column;
  PaddedBlock& to = row == column ? diagonal_[row] : below_[lower ? slot(row, column) : slot(column, row)];
  const Mat3 part = lower ? b : transposed(b);
  const Vec3 rows[3] = {part.r0, part.r1, part.r2};
  for (int r = 0; r < 3; ++r) to.row[r] += Lanes4{rows[r].x, rows[r].y, rows[r].z, 0};
}

BT_VECTOR bool SparseFactor::factorise(bool through) {
  bool definite = true;
  const int* target = target_.data();
  for (int k = 0; k < n_; ++k) {
    definite &= invert(diagonal_[k]);
    if (!definite && !through) return false;
    const int r = first_[k + 1] - first_[k];
    PaddedBlock* column = below_.data() + first_[k];
    scaled_.resize(r);
    for (int a = 0; a < r; ++a) multiply(column[a], diagonal_[k], scaled_[a]);
    for (int a = 0; a < r; ++a) {
      const PaddedBlock turned = transposed(column[a]);
      subtract_product(scaled_[a], turned, diagonal_[*target++]);
      for (int b = a + 1; b < r; ++b) subtract_product(scaled_[b], turned, below_[*target++]);
    }
    std::copy(scaled_.begin(), scaled_.end(), column);
  }
  return definite;
}

template <class Pivot>
void SparseFactor::substitute(std::vector<Vec3>& b, Pivot pivot) {
  std::vector<Vec3>& y = right_;
  y.resize(n_);
  for (int k = 0; k < n_; ++k) y[k] = b[node_[k]];
  for (int k = 0; k < n_; ++k)
    for (int a = first_[k]; a < first_[k + 1]; ++a) y[rows_[a]] -= product(below_[a], y[k]);
  for (int k = n_ - 1; k >= 0; --k) {
    Vec3 x = pivot(diagonal_[k], y[k]);
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      const PaddedBlock& l = below_[a];
      const Vec3 other = y[rows_[a]];
      x -= other.x * row_of(l, 0) + other.y * row_of(l, 1) + other.z * row_of(l, 2);
    }
    y[k] = b[node_[k]] = x;
  }
}

void SparseFactor::solve(std::vector<Vec3>& b) {
  substitute(b, [](const PaddedBlock& inverse, Vec3 y) { return product(inverse, y); });
}

void SparseFactor::solve_negative(std::vector<Vec3>& b) {
  substitute(
      b, [](const PaddedBlock& inverse, Vec3 y) { return -(positive_part(-1.0 * symmetric(inverse)) * y); });
}

BT_VECTOR void SparseFactor::solve(Columns& b) {
  if (!columns_.fits(n_)) columns_.resize(n_);
  Columns& y = columns_;
  for (int k = 0; k < n_; ++k) std::copy(b.at(node_[k]), b.at(node_[k]) + 3, y.at(k));
  Eight part[3];
  for (int k = 0; k < n_; ++k)
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      multiply(below_[a], y.at(k), part);
      subtract(y.at(rows_[a]), part);
    }
  for (int k = n_ - 1; k >= 0; --k) {
    Eight x[3];
    multiply(diagonal_[k], y.at(k), x);
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      multiply_transposed(below_[a], y.at(rows_[a]), part);
      subtract(x, part);
    }
    std::copy(x, x + 3, y.at(k));
    std::copy(x, x + 3, b.at(node_[k]));
  }
}

}  // namespace bt
