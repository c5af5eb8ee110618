// Which tendons are solved together, and their solution.
#include <algorithm>
#include <limits>
#include <numeric>

#include "solver/island_step.h"
#include "world/world.h"

namespace bt {

int World::island_root(int tendon) {
  while (island_of_[tendon] != tendon) tendon = island_of_[tendon] = island_of_[island_of_[tendon]];
  return tendon;
}

void World::join_islands(int a, int b) {
  island_of_[island_root(std::max(a, b))] = island_root(std::min(a, b));
}

// Tendons that a contact or a body joins are solved together (union-find).
void World::make_islands() {
  const int count = static_cast<int>(slots_.size());
  island_of_.resize(count);
  std::iota(island_of_.begin(), island_of_.end(), 0);
  for (const Contact& contact : contacts_)
    if (contact.b.tendon >= 0) join_islands(contact.a.tendon, contact.b.tendon);
  find_bodies();
  narrow_bodies();
  islands_.resize(count);
  for (int c = 0; c < count; ++c) {
    Island& g = islands_[c];
    g.tendons.clear();
    g.numbers.clear();
    g.contacts.clear();
    g.bodies.clear();
    g.carried.clear();
    g.slots = &slots_;
    g.all_bodies = &bodies;
    g.links = &links;
    g.reach = context_.reach;
    g.freedom = 0;
    g.coupled = false;
    g.patterned = false;
    g.finite = true;
    g.converged = true;
    g.left_predicted_region = false;
    g.iterations = 0;
    g.residual = 0;
    g.linear_tolerance = 0;
  }
  for (int c = 0; c < count; ++c) {
    if (!slots_[c]) continue;
    Island& g = islands_[island_root(c)];
    g.tendons.push_back(slots_[c]);
    g.numbers.push_back(c);
  }
  for (Contact& contact : contacts_) {
    Island& g = islands_[island_root(contact.a.tendon)];
    g.contacts.push_back(&contact);
    g.coupled |= contact.b.tendon >= 0;
  }
  for (size_t m = 0; m < bodies.size(); ++m)
    if (bodies[m].unknowns.any) {
      Island& g = islands_[island_root(touches_[m])];
      g.bodies.push_back(static_cast<int>(m));
      bodies[m].unknowns.first = g.freedom, g.freedom += bodies[m].unknowns.freedom;
    }
  for (size_t l = 0; l < links.size(); ++l)
    if (links[l].yields() && bodies[links[l].body].unknowns.any)
      islands_[island_root(touches_[links[l].body])].carried.push_back(static_cast<int>(l));
}

// false: some solution is not finite.
bool World::solve_each_island() {
  bool finite = true;
  attempt_ = Report{};
  unsettled_ = false;
  for (Island& g : islands_) {
    if (g.tendons.empty()) continue;
    bt::solve(g, context_);
    if (!g.finite) g.residual = std::numeric_limits<double>::infinity();
    finite &= g.finite;
    unsettled_ |= !g.converged && !g.left_predicted_region;
    attempt_.iterations = std::max(attempt_.iterations, g.iterations);
    ++attempt_.islands;
    attempt_.converged &= g.converged;
    if (!(g.residual <= attempt_.residual) || attempt_.worst_tendon < 0) read_worst(g);
  }
  attempt_.contacts = static_cast<long>(contacts_.size());
  report_.iterations += attempt_.iterations;
  return finite;
}

}  // namespace bt
