// A binary tree of the boxes around items, which finds the items that are near to a box.
#pragma once
#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "geometry/bounds.h"

namespace bt {

// Squared distance of two boxes.
inline double square_between(const Box& p, const Box& q) {
  const Vec3 apart = gap_between(p, q);
  return dot(apart, apart);
}

class BoxTree {
 public:
  BoxTree() = default;
  // boxes: of the items. Halves these by number, across the longest side of their box, down to `leaf` items.
  BoxTree(const std::vector<Box>& boxes, int leaf);
  // Number of each item as it was given, in the order of the leaves.
  const std::vector<int>& order() const { return order_; }
  Box box() const { return nodes_.empty() ? Box{} : nodes_.front().box; }
  // Calls found(k) for the items of the leaves within reach of a box, by their order. The reach may shrink
  // meanwhile: of each node's children the nearer one comes first.
  template <class Found>
  void visit(const Box& around, const double& reach, Found found) const;
  // Calls found(k) for the items of the leaves that no skip(box) leaves out, by their order.
  template <class Skip, class Found>
  void each(Skip skip, Found found, int node = 0) const {
    const Node& at = nodes_[node];
    if (skip(at.box)) return;
    if (at.second < 0) return each_of(at, found);
    each(skip, found, node + 1);
    each(skip, found, at.second);
  }

 private:
  // In order of depth first: the first child is the next node.
  struct Node {
    Box box;
    int first = 0, count = 0;  // its items
    int second = -1;           // its other child; -1: a leaf
  };
  template <class Found>
  static void each_of(const Node& node, Found found) {
    for (int k = node.first; k < node.first + node.count; ++k) found(k);
  }
  int build(const std::vector<Box>& boxes, int first, int count, int leaf);
  std::vector<int> order_;
  std::vector<Node> nodes_;
};

inline BoxTree::BoxTree(const std::vector<Box>& boxes, int leaf) : order_(boxes.size()) {
  std::iota(order_.begin(), order_.end(), 0);
  nodes_.reserve(2 * boxes.size());
  if (!boxes.empty()) build(boxes, 0, static_cast<int>(boxes.size()), leaf);
}

inline int BoxTree::build(const std::vector<Box>& boxes, int first, int count, int leaf) {
  const int at = static_cast<int>(nodes_.size());
  Node node{{}, first, count, -1};
  for (int k = first; k < first + count; ++k) node.box.include(boxes[order_[k]]);
  nodes_.push_back(node);
  if (count <= leaf) return at;
  const Vec3 size = node.box.hi - node.box.lo;
  const Vec3 axis = unit_axis(size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2);
  auto along = [&](int item) { return dot(boxes[item].lo + boxes[item].hi, axis); };
  const auto begin = order_.begin() + first;
  std::nth_element(begin, begin + count / 2, begin + count,
                   [&](int s, int t) { return along(s) < along(t); });
  build(boxes, first, count / 2, leaf);
  const int second = build(boxes, first + count / 2, count - count / 2, leaf);
  nodes_[at].second = second;
  return at;
}

template <class Found>
inline void BoxTree::visit(const Box& around, const double& reach, Found found) const {
  struct Open {
    int node;
    double square;
  };
  // One child waits at each depth, and halving by number leaves fewer than 32 of those.
  Open open[64];
  int count = 0;
  if (!nodes_.empty()) open[count++] = {0, square_between(nodes_[0].box, around)};
  while (count > 0) {
    const Open at = open[--count];
    if (at.square > reach * reach) continue;
    const Node& node = nodes_[at.node];
    if (node.second < 0) {
      each_of(node, found);
      continue;
    }
    Open first{at.node + 1, square_between(nodes_[at.node + 1].box, around)};
    Open second{node.second, square_between(nodes_[node.second].box, around)};
    if (first.square < second.square) std::swap(first, second);
    if (first.square <= reach * reach) open[count++] = first;
    if (second.square <= reach * reach) open[count++] = second;
  }
}

}  // namespace bt
