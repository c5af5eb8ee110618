// The Schur complement of the tendons (border.cpp), by the columns of columns.cpp and their answers.
#include <algorithm>

#include "stepping.h"

namespace bt {

namespace {

int first_of(size_t panel) { return static_cast<int>(panel) * kLanes; }

int count_of(const Group& group, size_t panel) { return std::min(kLanes, group.freedom - first_of(panel)); }

// C^T A^-1 C, of the columns of panel p, by the first rows of panel q.
template <int Rows>
BT_WITHIN inline void multiply_answers(const Group& group, size_t p, size_t q, Eight* out) {
  Eight sums[Rows] = {};
  for (const Border& border : group.borders)
    for (int i : border.pulled)
      for (int c = 0; c < 3; ++c) {
        const Eight pull = border.panels[q].pulls.at(i)[c], answer = border.panels[p].answers.at(i)[c];
        for (int a = 0; a < Rows; ++a) sums[a] += pull[a] * answer;
      }
  for (int a = 0; a < Rows; ++a) out[a] = sums[a];
}

BT_VECTOR void multiply_answers(const Group& group, size_t p, size_t q, int rows, Eight* sums) {
  rows <= 3   ? multiply_answers<3>(group, p, q, sums)
  : rows <= 6 ? multiply_answers<6>(group, p, q, sums)
              : multiply_answers<kLanes>(group, p, q, sums);
}

// C^T x, of panel p.
BT_VECTOR void multiply_steps(const Group& group, size_t p, Which x, Eight& sum) {
  for (size_t k = 0; k < group.borders.size(); ++k) {
    const Border& border = group.borders[k];
    for (int i : border.pulled)
      for (int c = 0; c < 3; ++c) sum += (group.chains[k]->*x)[c][i] * border.panels[p].pulls.at(i)[c];
  }
}

// Takes panel p's pulls, each by its share, from a tendon's column.
BT_VECTOR void take_pulls(const Border& border, size_t p, const Eight& shares, Field& from) {
  for (int i : border.pulled)
    for (int c = 0; c < 3; ++c) {
      const Eight all = shares * border.panels[p].pulls.at(i)[c];
      double sum = 0;
      for (int j = 0; j < kLanes; ++j) sum += all[j];
      from[c][i] -= sum;
    }
}

}  // namespace

void take_column(Group& group, size_t p, int lane) {
  for (size_t k = 0; k < group.chains.size(); ++k)
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < group.chains[k]->n(); ++i)
        group.chains[k]->column[c][i] = group.borders[k].panels[p].pulls.at(i)[c][lane];
}

void put_answer(Group& group, size_t p, int lane) {
  for (size_t k = 0; k < group.chains.size(); ++k)
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < group.chains[k]->n(); ++i)
        group.borders[k].panels[p].answers.at(i)[c][lane] = group.chains[k]->solved[c][i];
}

void take_complement(Group& group, size_t p, size_t q) {
  Eight sums[kLanes] = {};
  multiply_answers(group, p, q, count_of(group, q), sums);
  auto entry = [&](int i, int j) -> double& {
    return group.corner[static_cast<size_t>(i) * group.freedom + j];
  };
  for (int a = 0; a < count_of(group, q); ++a)
    for (int j = 0; j < count_of(group, p); ++j) {
      const int row = first_of(q) + a, column = first_of(p) + j;
      entry(row, column) -= sums[a][j];
      if (p != q) entry(column, row) = entry(row, column);
    }
}

void take_steps(Group& group, size_t p, Which x) {
  Eight sum{};
  multiply_steps(group, p, x, sum);
  for (int j = 0; j < count_of(group, p); ++j) group.corner_side[first_of(p) + j] -= sum[j];
}

void answer_bodies(Group& group, Which b) {
  if (b != &Chain::column) combine(group, 1, b, 0, &Chain::column);
  for (size_t p = 0; first_of(p) < group.freedom; ++p) {
    Eight shares{};
    for (int j = 0; j < count_of(group, p); ++j) shares[j] = group.corner_side[first_of(p) + j];
    for (size_t k = 0; k < group.chains.size(); ++k)
      take_pulls(group.borders[k], p, shares, group.chains[k]->column);
  }
}

}  // namespace bt
