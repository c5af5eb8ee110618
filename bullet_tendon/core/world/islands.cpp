// Which tendons are solved together, and their solution.
#include <algorithm>
#include <limits>
#include <numeric>

#include "solver/island_step.h"
#include "world/world.h"

namespace bt {

int World::group_root(int chain) {
  while (group_of_[chain] != chain) chain = group_of_[chain] = group_of_[group_of_[chain]];
  return chain;
}

void World::join_groups(int a, int b) { group_of_[group_root(std::max(a, b))] = group_root(std::min(a, b)); }

// Tendons that a row or a body joins are solved together (union-find).
void World::make_groups() {
  const int count = static_cast<int>(slots_.size());
  group_of_.resize(count);
  std::iota(group_of_.begin(), group_of_.end(), 0);
  for (const Row& row : rows_)
    if (row.b.chain >= 0) join_groups(row.a.chain, row.b.chain);
  find_bodies();
  narrow_bodies();
  groups_.resize(count);
  for (int c = 0; c < count; ++c) {
    Group& g = groups_[c];
    g.chains.clear(), g.numbers.clear(), g.rows.clear(), g.extra.clear();
    g.slots = &slots_, g.coupled = false, g.finite = true, g.converged = true, g.iterations = 0,
    g.residual = 0, g.strays = false;
    g.linear_tolerance = 0, g.patterned = false;
    g.movers = &movers, g.links = &links, g.reach = context_.reach, g.freedom = 0;
    g.bodies.clear(), g.carried.clear();
  }
  for (int c = 0; c < count; ++c)
    if (slots_[c])
      groups_[group_root(c)].chains.push_back(slots_[c]), groups_[group_root(c)].numbers.push_back(c);
  for (Row& row : rows_) {
    Group& g = groups_[group_root(row.a.chain)];
    g.rows.push_back(&row);
    g.coupled |= row.b.chain >= 0;
  }
  for (size_t m = 0; m < movers.size(); ++m)
    if (movers[m].unknown) {
      Group& g = groups_[group_root(touches_[m])];
      g.bodies.push_back(static_cast<int>(m));
      movers[m].first = g.freedom, g.freedom += movers[m].freedom;
    }
  for (size_t l = 0; l < links.size(); ++l)
    if (links[l].yields() && movers[links[l].mover].unknown)
      groups_[group_root(touches_[links[l].mover])].carried.push_back(static_cast<int>(l));
}

// false: some solution is not finite.
bool World::solve_groups() {
  bool finite = true;
  attempt_ = Report{};
  unsettled_ = stray_ = false;
  found_.clear();
  for (Group& g : groups_) {
    if (g.chains.empty()) continue;
    bt::solve(g, context_);
    found_.insert(found_.end(), g.extra.begin(), g.extra.end());
    if (!g.finite) g.residual = std::numeric_limits<double>::infinity();
    finite &= g.finite;
    stray_ |= g.strays;
    unsettled_ |= !g.converged && !g.strays;
    attempt_.iterations = std::max(attempt_.iterations, g.iterations);
    ++attempt_.groups;
    attempt_.converged &= g.converged;
    if (!(g.residual <= attempt_.residual) || attempt_.worst_chain < 0) read_worst(g);
  }
  rows_.insert(rows_.end(), found_.begin(), found_.end());
  attempt_.rows = static_cast<long>(rows_.size());
  report_.iterations += attempt_.iterations;
  return finite;
}

}  // namespace bt
