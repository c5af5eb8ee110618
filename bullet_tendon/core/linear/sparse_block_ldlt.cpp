#include "linear/sparse_block_ldlt.h"

#include <algorithm>
#include <vector>

#include "math/simd.h"

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

inline bool invert(PaddedBlock& b) {
  Sym3 a{b.row[0][0], b.row[0][1], b.row[0][2], b.row[1][1], b.row[1][2], b.row[2][2]};
  if (!invert_definite(a)) return false;
  b = {{Lanes4{a.xx, a.xy, a.xz, 0}, Lanes4{a.xy, a.yy, a.yz, 0}, Lanes4{a.xz, a.yz, a.zz, 0}}};
  return true;
}

inline Vec3 row_of(const PaddedBlock& b, int i) { return {b.row[i][0], b.row[i][1], b.row[i][2]}; }

}  // namespace

Block3 product(const Block3& a, const Block3& b) {
  Block3 c{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      c.v[3 * i + j] = a.v[3 * i] * b.v[j] + a.v[3 * i + 1] * b.v[3 + j] + a.v[3 * i + 2] * b.v[6 + j];
  return c;
}

Block3 block_of(const Sym3& s) { return {{s.xx, s.xy, s.xz, s.xy, s.yy, s.yz, s.xz, s.yz, s.zz}}; }

void SparseFactor::analyse(int n, const Edges& edges) {
  if (n == n_ && edges == edges_) return;
  n_ = n;
  edges_ = edges;
  find_neighbours();
  node_ = minimum_degree_.order(graph_);
  find_columns();
  plan_updates();
  diagonal_.resize(n_);
  below_.resize(rows_.size());
}

void SparseFactor::find_neighbours() {
  std::vector<int>&first = graph_.first, &nodes = graph_.nodes;
  first.assign(n_ + 2, 0);
  for (auto [i, j] : edges_) {
    ++first[i + 2];
    ++first[j + 2];
  }
  for (int i = 0; i < n_; ++i) first[i + 2] += first[i + 1];
  nodes.resize(2 * edges_.size());
  for (auto [i, j] : edges_) {
    nodes[first[i + 1]++] = j;
    nodes[first[j + 1]++] = i;
  }
  first.pop_back();
  int kept = 0;
  for (int i = 0, from = 0; i < n_; ++i) {
    const int to = first[i + 1];
    std::sort(nodes.begin() + from, nodes.begin() + to);
    for (int k = from; k < to; ++k)
      if (k == from || nodes[k] != nodes[k - 1]) nodes[kept++] = nodes[k];
    from = to;
    first[i + 1] = kept;
  }
  nodes.resize(kept);
}

// The blocks below pivot k: its later neighbours, and the blocks below those pivots whose first block below
// is k.
void SparseFactor::find_columns() {
  where_.resize(n_);
  for (int k = 0; k < n_; ++k) where_[node_[k]] = k;
  first_.assign(1, 0);
  rows_.clear();
  child_.assign(n_, -1);
  sibling_.assign(n_, -1);
  seen_.assign(n_, -1);
  for (int k = 0; k < n_; ++k) {
    seen_[k] = k;
    auto take = [&](int row) {
      if (row > k && seen_[row] != k) {
        seen_[row] = k;
        rows_.push_back(row);
      }
    };
    for (int a = graph_.first[node_[k]]; a < graph_.first[node_[k] + 1]; ++a) take(where_[graph_.nodes[a]]);
    for (int c = child_[k]; c >= 0; c = sibling_[c])
      for (int a = first_[c]; a < first_[c + 1]; ++a) take(rows_[a]);
    std::sort(rows_.begin() + first_[k], rows_.end());
    first_.push_back(static_cast<int>(rows_.size()));
    if (first_[k + 1] == first_[k]) continue;
    const int parent = rows_[first_[k]];
    sibling_[k] = child_[parent];
    child_[parent] = k;
  }
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

void SparseFactor::add(int i, int j, const Block3& b) {
  const int row = where_[i], column = where_[j];
  const bool lower = row >= column;
  PaddedBlock& to = row == column ? diagonal_[row] : below_[lower ? slot(row, column) : slot(column, row)];
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) to.row[r][c] += lower ? b.v[3 * r + c] : b.v[3 * c + r];
}

BT_VECTOR bool SparseFactor::factorise() {
  const int* target = target_.data();
  for (int k = 0; k < n_; ++k) {
    if (!invert(diagonal_[k])) return false;
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
  return true;
}

void SparseFactor::solve(std::vector<Vec3>& b) {
  std::vector<Vec3>& y = right_;
  y.resize(n_);
  for (int k = 0; k < n_; ++k) y[k] = b[node_[k]];
  for (int k = 0; k < n_; ++k)
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      const PaddedBlock& l = below_[a];
      y[rows_[a]] -= Vec3{dot(row_of(l, 0), y[k]), dot(row_of(l, 1), y[k]), dot(row_of(l, 2), y[k])};
    }
  for (int k = n_ - 1; k >= 0; --k) {
    const PaddedBlock& d = diagonal_[k];
    Vec3 x{dot(row_of(d, 0), y[k]), dot(row_of(d, 1), y[k]), dot(row_of(d, 2), y[k])};
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      const PaddedBlock& l = below_[a];
      const Vec3 other = y[rows_[a]];
      x -= other.x * row_of(l, 0) + other.y * row_of(l, 1) + other.z * row_of(l, 2);
    }
    y[k] = b[node_[k]] = x;
  }
}

}  // namespace bt
