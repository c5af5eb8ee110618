#include "sparse.h"

#include <algorithm>

namespace bt {

namespace {

// c -= a b^T
void subtract_product(Block3& c, const Block3& a, const Block3& b) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      c.v[3 * i + j] -=
          a.v[3 * i] * b.v[3 * j] + a.v[3 * i + 1] * b.v[3 * j + 1] + a.v[3 * i + 2] * b.v[3 * j + 2];
}

bool invert(Block3& b) {
  Sym3 a{b.v[0], b.v[1], b.v[2], b.v[4], b.v[5], b.v[8]};
  if (!invert_definite(a)) return false;
  b = block_of(a);
  return true;
}

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
  n_ = n, edges_ = edges;
  find_neighbours();
  node_ = minimum_degree_.order(graph_);
  find_columns();
  plan_updates();
  diagonal_.resize(n_), below_.resize(rows_.size());
}

void SparseFactor::find_neighbours() {
  std::vector<int>&first = graph_.first, &nodes = graph_.nodes;
  first.assign(n_ + 2, 0);
  for (auto [i, j] : edges_) ++first[i + 2], ++first[j + 2];
  for (int i = 0; i < n_; ++i) first[i + 2] += first[i + 1];
  nodes.resize(2 * edges_.size());
  for (auto [i, j] : edges_) nodes[first[i + 1]++] = j, nodes[first[j + 1]++] = i;
  first.pop_back();
  int kept = 0;
  for (int i = 0, from = 0; i < n_; ++i) {
    const int to = first[i + 1];
    std::sort(nodes.begin() + from, nodes.begin() + to);
    for (int k = from; k < to; ++k)
      if (k == from || nodes[k] != nodes[k - 1]) nodes[kept++] = nodes[k];
    from = to, first[i + 1] = kept;
  }
  nodes.resize(kept);
}

// What is below pivot k: its later neighbours, and what is below those pivots whose first block is k.
void SparseFactor::find_columns() {
  where_.resize(n_);
  for (int k = 0; k < n_; ++k) where_[node_[k]] = k;
  first_.assign(1, 0), rows_.clear();
  child_.assign(n_, -1), sibling_.assign(n_, -1), seen_.assign(n_, -1);
  for (int k = 0; k < n_; ++k) {
    seen_[k] = k;
    auto take = [&](int row) {
      if (row > k && seen_[row] != k) seen_[row] = k, rows_.push_back(row);
    };
    for (int a = graph_.first[node_[k]]; a < graph_.first[node_[k] + 1]; ++a) take(where_[graph_.nodes[a]]);
    for (int c = child_[k]; c >= 0; c = sibling_[c])
      for (int a = first_[c]; a < first_[c + 1]; ++a) take(rows_[a]);
    std::sort(rows_.begin() + first_[k], rows_.end());
    first_.push_back(static_cast<int>(rows_.size()));
    if (first_[k + 1] == first_[k]) continue;
    const int parent = rows_[first_[k]];
    sibling_[k] = child_[parent], child_[parent] = k;
  }
}

int SparseFactor::slot(int row, int column) const {
  auto from = rows_.begin() + first_[column], to = rows_.begin() + first_[column + 1];
  return static_cast<int>(std::lower_bound(from, to, row) - rows_.begin());
}

// What is below pivot k after its row r is below pivot r too, in the same order.
void SparseFactor::plan_updates() {
  target_.clear();
  for (int k = 0; k < n_; ++k)
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      target_.push_back(~rows_[a]);
      for (int b = a + 1, at = first_[rows_[a]]; b < first_[k + 1]; ++b, ++at) {
        while (rows_[at] != rows_[b]) ++at;
        target_.push_back(at);
      }
    }
}

void SparseFactor::start() {
  std::fill(diagonal_.begin(), diagonal_.end(), Block3{});
  std::fill(below_.begin(), below_.end(), Block3{});
}

void SparseFactor::add(int i, int j, const Block3& b) {
  const int row = where_[i], column = where_[j];
  if (row == column) {
    for (int e = 0; e < 9; ++e) diagonal_[row].v[e] += b.v[e];
    return;
  }
  const bool lower = row > column;
  double* to = below_[lower ? slot(row, column) : slot(column, row)].v;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) to[3 * r + c] += lower ? b.v[3 * r + c] : b.v[3 * c + r];
}

bool SparseFactor::factorise() {
  const int* target = target_.data();
  for (int k = 0; k < n_; ++k) {
    if (!invert(diagonal_[k])) return false;
    const int from = first_[k], to = first_[k + 1];
    scaled_.resize(to - from);
    for (int a = from; a < to; ++a) scaled_[a - from] = product(below_[a], diagonal_[k]);
    for (int a = from; a < to; ++a)
      for (int b = a; b < to; ++b, ++target)
        subtract_product(*target < 0 ? diagonal_[~*target] : below_[*target], scaled_[b - from], below_[a]);
    std::copy(scaled_.begin(), scaled_.end(), below_.begin() + from);
  }
  return true;
}

void SparseFactor::solve(std::vector<Vec3>& b) {
  std::vector<Vec3>& y = right_;
  y.resize(n_);
  for (int k = 0; k < n_; ++k) y[k] = b[node_[k]];
  for (int k = 0; k < n_; ++k)
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      const double* l = below_[a].v;
      y[rows_[a]] -=
          Vec3{dot({l[0], l[1], l[2]}, y[k]), dot({l[3], l[4], l[5]}, y[k]), dot({l[6], l[7], l[8]}, y[k])};
    }
  for (int k = n_ - 1; k >= 0; --k) {
    const double* d = diagonal_[k].v;
    Vec3 x{dot({d[0], d[1], d[2]}, y[k]), dot({d[3], d[4], d[5]}, y[k]), dot({d[6], d[7], d[8]}, y[k])};
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      const double* l = below_[a].v;
      const Vec3 other = y[rows_[a]];
      x -= other.x * Vec3{l[0], l[1], l[2]} + other.y * Vec3{l[3], l[4], l[5]} +
           other.z * Vec3{l[6], l[7], l[8]};
    }
    y[k] = b[node_[k]] = x;
  }
}

}  // namespace bt
