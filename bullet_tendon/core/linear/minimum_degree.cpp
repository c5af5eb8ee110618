// Minimum degree on the quotient graph. An eliminated pivot p becomes an element, which represents the clique
// L_p of the variables that it joins. Therefore fill-in is never stored. With the elements E_i and the
// variables A_i adjacent to a variable i,
//
//   L_p = (A_p u union of L_e, e in E_p) \ p,   the elements E_p are absorbed by p
//   d_i = |A_i \ i| + |L_p \ i| + sum over e in E_i \ p of |L_e \ L_p|
//
// The last sum counts variables that several elements share several times. It is an upper bound that needs no
// union. Variables with the same neighbours (twins) are eliminated as one. Variables without neighbours
// outside L_p are eliminated together with p.
#include "linear/minimum_degree.h"

#include <algorithm>
#include <vector>

namespace bt {

const std::vector<int>& MinimumDegree::order(const Adjacency& graph) {
  start(graph);
  while (left_ > 0) {
    const int p = lightest();
    make_element(p);
    measure_elements(p);
    for (int k = start_[p]; k < start_[p] + length_[p]; ++k) update(p, lists_[k]);
    merge_twins(p);
    finish_element(p);
  }
  write_order();
  return order_;
}

void MinimumDegree::start(const Adjacency& graph) {
  n_ = left_ = graph.count();
  least_ = 0;
  stamp_ = 0;
  lists_.assign(graph.nodes.begin(), graph.nodes.end());
  start_.assign(graph.first.begin(), graph.first.end() - 1);
  length_.resize(n_);
  last_.resize(n_);
  elements_.assign(n_, 0);
  weight_.assign(n_, 1);
  alive_.assign(n_, 0);
  outside_.assign(n_, 0);
  seen_.assign(n_, 0);
  mark_.assign(n_, 0);
  head_.assign(n_ + 1, -1);
  next_.assign(n_, -1);
  previous_.assign(n_, -1);
  hash_head_.assign(n_, -1);
  hash_next_.assign(n_, -1);
  hash_of_.assign(n_, 0);
  follower_.assign(n_, -1);
  pivots_.clear();
  for (int i = 0; i < n_; ++i) {
    length_[i] = graph.first[i + 1] - graph.first[i];
    last_[i] = i;
  }
  degree_ = length_;
  for (int i = n_ - 1; i >= 0; --i) link(i);
}

void MinimumDegree::link(int i) {
  int& head = head_[degree_[i]];
  next_[i] = head;
  previous_[i] = -1;
  if (head >= 0) previous_[head] = i;
  head = i;
  least_ = std::min(least_, degree_[i]);
}

void MinimumDegree::unlink(int i) {
  (previous_[i] >= 0 ? next_[previous_[i]] : head_[degree_[i]]) = next_[i];
  if (next_[i] >= 0) previous_[next_[i]] = previous_[i];
}

int MinimumDegree::lightest() {
  while (head_[least_] < 0) ++least_;
  const int p = head_[least_];
  unlink(p);
  left_ -= weight_[p];
  pivots_.push_back(p);
  return p;
}

// Appends the variables among lists_[from ... to) that are not in L_p yet to L_p.
void MinimumDegree::take(int p, int from, int to) {
  for (int k = from; k < to; ++k) {
    const int i = lists_[k];
    if (i == p || weight_[i] == 0 || mark_[i] == stamp_) continue;
    mark_[i] = stamp_;
    lists_.push_back(i);
  }
}

void MinimumDegree::make_element(int p) {
  fresh_stamp();
  const int from = start_[p], middle = from + elements_[p], to = from + length_[p];
  const int begin = static_cast<int>(lists_.size());
  for (int k = from; k < middle; ++k) {
    const int e = lists_[k];
    if (!alive_[e]) continue;
    alive_[e] = 0;
    take(p, start_[e], start_[e] + length_[e]);
  }
  take(p, middle, to);
  start_[p] = begin;
  length_[p] = static_cast<int>(lists_.size()) - begin;
  alive_[p] = 1;
  elements_[p] = 0;
  degree_[p] = 0;
  for (int k = begin; k < begin + length_[p]; ++k) degree_[p] += weight_[lists_[k]];
}

void MinimumDegree::measure_elements(int p) {
  for (int k = start_[p]; k < start_[p] + length_[p]; ++k) {
    const int i = lists_[k];
    for (int m = start_[i]; m < start_[i] + elements_[i]; ++m) {
      const int e = lists_[m];
      if (!alive_[e]) continue;
      if (seen_[e] != stamp_) {
        seen_[e] = stamp_;
        outside_[e] = degree_[e];
      }
      outside_[e] -= weight_[i];
    }
  }
}

// Updates the lists and the degree of a variable i of L_p. Its list has space for p, because p was a
// neighbour, or an absorbed element was.
void MinimumDegree::update(int p, int i) {
  unlink(i);
  const int from = start_[i], middle = from + elements_[i], to = from + length_[i];
  int degree = 0, kept = from;
  unsigned hash = 0;
  for (int k = from; k < middle; ++k) {
    const int e = lists_[k];
    if (!alive_[e]) continue;
    if (outside_[e] == 0) {  // all of it is in L_p
      alive_[e] = 0;
      continue;
    }
    degree += outside_[e];
    hash += e;
    lists_[kept++] = e;
  }
  const int elements = kept - from;
  int variables = 0;
  for (int k = middle; k < to; ++k) {
    const int j = lists_[k];
    if (j == p || weight_[j] == 0 || mark_[j] == stamp_) continue;
    degree += weight_[j];
    hash += j;
    lists_[from + elements + variables++] = j;
  }
  if (degree == 0) {  // no neighbours outside L_p
    left_ -= weight_[i];
    degree_[p] -= weight_[i];
    join(i, p);
    return;
  }
  // p replaces the first variable, which moves to the end.
  lists_[from + elements + variables] = lists_[from + elements];
  lists_[from + elements] = p;
  elements_[i] = elements + 1;
  length_[i] = elements + 1 + variables;
  degree_[i] = std::min(degree_[i], degree);
  hash_of_[i] = static_cast<int>(hash % static_cast<unsigned>(n_));
  hash_next_[i] = hash_head_[hash_of_[i]];
  hash_head_[hash_of_[i]] = i;
}

// The nodes of i are eliminated right after those of `into`.
void MinimumDegree::join(int i, int into) {
  follower_[last_[into]] = i;
  last_[into] = last_[i];
  weight_[i] = 0;
}

bool MinimumDegree::twins(int i, int j) {
  if (length_[i] != length_[j] || elements_[i] != elements_[j]) return false;
  for (int k = start_[j]; k < start_[j] + length_[j]; ++k)
    if (mark_[lists_[k]] != stamp_) return false;
  return true;
}

void MinimumDegree::merge_twins(int p) {
  for (int k = start_[p]; k < start_[p] + length_[p]; ++k) {
    const int first = lists_[k];
    if (weight_[first] == 0) continue;
    int i = hash_head_[hash_of_[first]];
    hash_head_[hash_of_[first]] = -1;
    for (; i >= 0; i = hash_next_[i]) {
      if (weight_[i] == 0 || hash_next_[i] < 0) continue;
      fresh_stamp();
      for (int m = start_[i]; m < start_[i] + length_[i]; ++m) mark_[lists_[m]] = stamp_;
      for (int j = hash_next_[i]; j >= 0; j = hash_next_[j]) {
        if (weight_[j] == 0 || !twins(i, j)) continue;
        weight_[i] += weight_[j];
        join(j, i);
      }
    }
  }
}

// Removes eliminated and merged variables from L_p, and sets the degrees of its variables.
void MinimumDegree::finish_element(int p) {
  const int from = start_[p];
  int kept = from;
  for (int k = from; k < from + length_[p]; ++k) {
    const int i = lists_[k];
    if (weight_[i] == 0) continue;
    lists_[kept++] = i;
    degree_[i] = std::min(degree_[i] + degree_[p], left_) - weight_[i];
    link(i);
  }
  length_[p] = kept - from;
  weight_[p] = 0;
  lists_.resize(kept);
  if (length_[p] == 0) alive_[p] = 0;
}

void MinimumDegree::write_order() {
  order_.clear();
  for (int p : pivots_)
    for (int i = p; i >= 0; i = follower_[i]) order_.push_back(i);
}

}  // namespace bt
