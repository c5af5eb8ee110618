#include "places.h"

#include <algorithm>
#include <cmath>

#include "assembly.h"
#include "constants.h"

namespace bt {

namespace {

// Bodies that are unknown, and particles that are constrained directly, are part of everything; and one
// tendon is a place of its own.
bool may_have_places(const Group& group) {
  return group.coupled && group.chains.size() > 1 && group.bodies.empty() &&
         std::none_of(group.rows.begin(), group.rows.end(), [](const Row* row) { return row->direct; });
}

}  // namespace

bool Places::solve(Group& group, const StepContext& context) {
  if (!may_have_places(group) || !find(group)) return false;
  gather(group);
  iterate(context);
  hand_back(group);
  return true;
}

// false: they are most of it.
bool Places::find(const Group& group) {
  auto few = [&] { return std::count(near_.begin(), near_.end(), 1) <= kFewPlaces * near_.size(); };
  mark_residuals(group);
  if (!few()) return false;
  widen(group);
  return few();
}

void Places::mark_residuals(const Group& group) {
  double most = 0;
  for (const Chain* c : group.chains) most = std::max(most, c->residual_norm);
  first_.assign(group.slots->size(), -1);
  near_.clear();
  for (size_t k = 0; k < group.chains.size(); ++k) {
    const Chain& c = *group.chains[k];
    first_[group.numbers[k]] = static_cast<int>(near_.size());
    for (int i = 0; i < c.n(); ++i) near_.push_back(max_abs(c.residual.at(i)) > kPlaceResidual * most);
  }
}

// Along the tendons: particles that are held between two others can move across them only.
void Places::widen(const Group& group) {
  marked_ = near_;
  for (size_t k = 0; k < group.chains.size(); ++k) {
    const int n = group.chains[k]->n(), first = first_[group.numbers[k]];
    for (int i = 0; i < n; ++i) {
      if (!marked_[first + i]) continue;
      const int from = std::max(0, i - kPlaceReach), to = std::min(n - 1, i + kPlaceReach);
      std::fill(near_.begin() + first + from, near_.begin() + first + to + 1, 1);
    }
  }
}

bool Places::any_near(const Spot& s) const {
  if (s.chain < 0) return false;
  const int i = first_[s.chain] + s.first;
  return near_[i] || near_[i + 1];
}

void Places::gather(Group& group) {
  part_.slots = group.slots, part_.movers = group.movers, part_.links = group.links;
  part_.part_end = group.part_end, part_.part_root = group.part_root, part_.reach = group.reach;
  part_.coupled = true, part_.patterned = part_.stayed = false;
  part_.follows = group.follows, part_.most_jump = group.most_jump;
  part_.chains.clear(), part_.numbers.clear(), part_.rows.clear(), part_.still.clear();
  for (size_t k = 0; k < group.chains.size(); ++k) {
    const auto from = near_.begin() + first_[group.numbers[k]], to = from + group.chains[k]->n();
    if (std::find(from, to, 1) == to) continue;
    part_.chains.push_back(group.chains[k]), part_.numbers.push_back(group.numbers[k]);
    for (auto at = from; at != to; ++at) part_.still.push_back(!*at);
  }
  for (Row* row : group.rows)
    if (any_near(row->a) || any_near(row->b)) part_.rows.push_back(row);
}

// false: there is none.
bool Places::step(const StepContext& context) {
  bool found = false;
  for (bool definite : {false, true}) {
    if (definite) residual_of(part_, false, true);
    assemble(part_, Linearisation::multiplier, definite, true);
    if ((found = solve_linear(part_, context, definite))) break;
  }
  if (!found) return false;
  measure_stride(part_);
  carry_springs(part_);
  foresee_contacts(part_);
  advance(part_, 1);
  return true;
}

void Places::iterate(const StepContext& context) {
  start_waiting(part_);
  double first = 0;
  for (int iteration = 0; iteration <= kPlaceIterations; ++iteration) {
    Assembly a = residual_of(part_, false, true);
    measure_residual(part_, a);
    if (iteration == 0) first = a.residual;
    if (!(iteration == 0 || a.residual > kPlaceResidual * first) || !std::isfinite(a.residual)) return;
    if (iteration == kPlaceIterations || !step(context)) return;
  }
}

void Places::hand_back(Group& group) {
  for (int c : part_.numbers) group.travelled[c] += part_.travelled[c];
  group.stayed |= part_.stayed;
  group.patterned = false;  // rows that join tendons have come
}

}  // namespace bt
