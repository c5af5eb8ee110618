#include "sparse.h"

#include <algorithm>
#include <set>

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
  std::vector<std::vector<int>> neighbours(n);
  for (auto [i, j] : edges) neighbours[i].push_back(j), neighbours[j].push_back(i);
  for (auto& list : neighbours) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  order(neighbours);
  plan_updates();
}

// Elimination by least degree: the block with the fewest neighbours next, which become neighbours of each
// other. Leaves in neighbours[i] those that were there when i was eliminated.
void SparseFactor::order(std::vector<std::vector<int>>& neighbours) {
  std::set<std::pair<size_t, int>> queue;
  for (int i = 0; i < n_; ++i) queue.insert({neighbours[i].size(), i});
  where_.assign(n_, -1), node_.clear();
  std::vector<int> joined;
  while (!queue.empty()) {
    const int i = queue.begin()->second;
    queue.erase(queue.begin());
    where_[i] = static_cast<int>(node_.size());
    node_.push_back(i);
    for (int j : neighbours[i]) {
      queue.erase({neighbours[j].size(), j});
      joined.clear();
      std::set_union(neighbours[j].begin(), neighbours[j].end(), neighbours[i].begin(), neighbours[i].end(),
                     std::back_inserter(joined));
      joined.erase(std::remove_if(joined.begin(), joined.end(), [&](int m) { return m == i || m == j; }),
                   joined.end());
      neighbours[j].swap(joined);
      queue.insert({neighbours[j].size(), j});
    }
  }
  first_.assign(1, 0), rows_.clear();
  for (int i : node_) {
    for (int j : neighbours[i]) rows_.push_back(where_[j]);
    std::sort(rows_.begin() + first_.back(), rows_.end());
    first_.push_back(static_cast<int>(rows_.size()));
  }
}

int SparseFactor::slot(int row, int column) const {
  auto from = rows_.begin() + first_[column], to = rows_.begin() + first_[column + 1];
  return static_cast<int>(std::lower_bound(from, to, row) - rows_.begin());
}

void SparseFactor::plan_updates() {
  target_.clear();
  for (int k = 0; k < n_; ++k)
    for (int a = first_[k]; a < first_[k + 1]; ++a) {
      target_.push_back(~rows_[a]);
      for (int b = a + 1; b < first_[k + 1]; ++b) target_.push_back(slot(rows_[b], rows_[a]));
    }
  diagonal_.resize(n_), below_.resize(rows_.size());
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
