// Pairs of segments that cannot touch yet are not evaluated.
//
// A gap shrinks by no more than both tendons travel: what is g apart, and has a force from g0 on, waits until
// that has added up to g - g0 since it was evaluated. Where points begin to follow what they touch
// (crossing.cpp), gaps are measured otherwise, and nothing waits. Rows are large, and most of a heap's do not
// act: what is only asked whether it waits or acts is kept apart from them.
#include "assembly.h"

namespace bt {

namespace {

double sum_of(const std::vector<double>& of_slots, const Waiting& pair) {
  return of_slots[pair.a] + of_slots[pair.b];
}

}  // namespace

void start_waiting(Group& group) {
  if (group.coupled) group.travelled.assign(group.slots->size(), 0), group.stride = group.travelled;
  wake(group);
}

void wake(Group& group) { group.waiting.clear(); }

bool waits(const Group& group, size_t r) {
  if (r >= group.waiting.size()) return false;
  const Waiting& pair = group.waiting[r];
  return pair.clear > 0 && sum_of(group.travelled, pair) < pair.clear;
}

void let_wait(Group& group, size_t r) {
  const Row& row = *group.rows[r];
  if (row.b.chain < 0 || row.acts() || row.multiplier > 0 || row.stiffness <= 0) return;
  const double room = row.gap - row.carried / row.stiffness;
  if (!(room > 0)) return;
  Waiting pair{0, row.a.chain, row.b.chain};
  pair.clear = sum_of(group.travelled, pair) + room;
  if (r >= group.waiting.size()) group.waiting.resize(group.rows.size());
  group.waiting[r] = pair;
}

void measure_stride(Group& group) {
  if (!group.coupled) return;
  for (size_t c = 0; c < group.chains.size(); ++c)
    group.stride[group.numbers[c]] = std::sqrt(3.0) * group.chains[c]->step.largest();
}

void travel(Group& group, double alpha) {
  if (!group.coupled) return;
  for (int c : group.numbers) group.travelled[c] += std::fabs(alpha) * group.stride[c];
}

void measure_waiting(Group& group, bool definite) {
  for (size_t r = 0; r < group.rows.size(); ++r)
    if (waits(group, r)) evaluate(group, *group.rows[r], false, definite);
}

void foresee_contacts(Group& group) {
  for (size_t r = 0; r < group.rows.size(); ++r) {
    Row& row = *group.rows[r];
    if (waits(group, r)) {
      const Waiting& pair = group.waiting[r];
      if (sum_of(group.travelled, pair) + sum_of(group.stride, pair) < pair.clear) continue;
      row.evaluate(relative_position(group, row, &Chain::next), false);
    }
    row.foresee(relative_position(group, row, &Chain::step));
  }
}

void find_acting(Group& group) {
  group.acting.clear();
  for (size_t r = 0; r < group.rows.size(); ++r)
    if (!waits(group, r) && group.rows[r]->acts()) group.acting.push_back(group.rows[r]);
}

}  // namespace bt
