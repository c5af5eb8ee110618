// What follows a solution, between the rounds of Newton's method.
#include "rounds.h"

#include <algorithm>
#include <cmath>

namespace bt {

namespace {

// true: some friction limit moved by more than `enough`.
bool update_friction(Group& group, double enough) {
  bool moved = false;
  for (Row* row : group.rows) {
    if (row->friction <= 0) continue;
    double limit = row->friction * row->normal_force;
    moved |= std::fabs(limit - row->limit) > std::max(enough, kFrictionAccuracy * limit);
    row->limit_friction(limit);
  }
  return moved;
}

// true: some contact was too deep, and has been made stiffer.
bool stiffen(Group& group) {
  bool any = false;
  for (Row* row : group.rows) any |= row->stiffen();
  return any;
}

}  // namespace

bool Rounds::next(Group& group, int iteration, double enough) {
  const bool slid = update_friction(group, enough);
  const bool missed = add_missed(group);
  const bool deep = stiffen(group);
  if (!slid && !missed && !deep) return false;
  ++count_, begun_ = iteration, fresh_ = true;
  return true;
}

}  // namespace bt
