// Which tendons are solved together, and their solution.
#include <algorithm>
#include <limits>
#include <numeric>

#include "solver/island_step.h"
#include "world/world.h"

namespace bt {

int World::island_root(int tendon) {
  while (islands_.parent[tendon] != tendon)
    tendon = islands_.parent[tendon] = islands_.parent[islands_.parent[tendon]];
  return tendon;
}

void World::join_islands(int a, int b) {
  islands_.parent[island_root(std::max(a, b))] = island_root(std::min(a, b));
}

// Tendons that a contact or a body joins are solved together (union-find).
void World::make_islands() {
  const int count = static_cast<int>(step_.slots.size());
  islands_.parent.resize(count);
  std::iota(islands_.parent.begin(), islands_.parent.end(), 0);
  for (const Contact& contact : contacts_.all)
    if (contact.b.tendon >= 0) join_islands(contact.a.tendon, contact.b.tendon);
  find_bodies();
  narrow_bodies();
  islands_.all.resize(count);
  for (int c = 0; c < count; ++c) {
    Island& g = islands_.all[c];
    g.tendons.clear();
    g.numbers.clear();
    g.contacts.clear();
    g.bodies.clear();
    g.carried.clear();
    g.slots = &step_.slots;
    g.all_bodies = &scene.bodies;
    g.links = &scene.links;
    g.reach = step_.context.reach;
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
    if (!step_.slots[c]) continue;
    Island& g = islands_.all[island_root(c)];
    g.tendons.push_back(step_.slots[c]);
    g.numbers.push_back(c);
  }
  for (Contact& contact : contacts_.all) {
    Island& g = islands_.all[island_root(contact.a.tendon)];
    g.contacts.push_back(&contact);
    g.coupled |= contact.b.tendon >= 0;
  }
  for (size_t m = 0; m < scene.bodies.size(); ++m)
    if (scene.bodies[m].unknowns.any) {
      Island& g = islands_.all[island_root(islands_.touches[m])];
      g.bodies.push_back(static_cast<int>(m));
      scene.bodies[m].unknowns.first = g.freedom, g.freedom += scene.bodies[m].unknowns.freedom;
    }
  for (size_t l = 0; l < scene.links.size(); ++l)
    if (scene.links[l].yields() && scene.bodies[scene.links[l].body].unknowns.any)
      islands_.all[island_root(islands_.touches[scene.links[l].body])].carried.push_back(static_cast<int>(l));
}

// false: some solution is not finite.
bool World::solve_each_island() {
  bool finite = true;
  step_.attempt = Report{};
  step_.unconverged = false;
  for (Island& g : islands_.all) {
    if (g.tendons.empty()) continue;
    bt::solve(g, step_.context);
    if (!g.finite) g.residual = std::numeric_limits<double>::infinity();
    finite &= g.finite;
    step_.unconverged |= !g.converged && !g.left_predicted_region;
    step_.attempt.iterations = std::max(step_.attempt.iterations, g.iterations);
    ++step_.attempt.islands;
    step_.attempt.converged &= g.converged;
    if (!(g.residual <= step_.attempt.residual) || step_.attempt.worst_tendon < 0) read_worst(g);
  }
  step_.attempt.contacts = static_cast<long>(contacts_.all.size());
  step_.report.iterations += step_.attempt.iterations;
  return finite;
}

}  // namespace bt
