// Divides the tendons into islands, and solves each island.
#include <algorithm>
#include <limits>
#include <numeric>

#include "solver/solver.h"
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

// Contacts and bodies join tendons to islands (union-find).
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
    g.bodies.indices.clear();
    g.bodies.carried.clear();
    g.slots = &step_.slots;
    g.bodies.all = &scene.bodies;
    g.bodies.links = &scene.links;
    g.bodies.reach = step_.context.reach;
    g.bodies.freedom = 0;
    g.coupled = false;
    g.matrix.patterned = false;
    g.result.finite = true;
    g.result.converged = true;
    g.result.left_predicted_region = false;
    g.result.iterations = 0;
    g.result.residual = 0;
    g.matrix.tolerance = 0;
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
      g.bodies.indices.push_back(static_cast<int>(m));
      scene.bodies[m].unknowns.first = g.bodies.freedom;
      g.bodies.freedom += scene.bodies[m].unknowns.freedom;
    }
  for (size_t l = 0; l < scene.links.size(); ++l)
    if (scene.links[l].yields() && scene.bodies[scene.links[l].body].unknowns.any)
      islands_.all[island_root(islands_.touches[scene.links[l].body])].bodies.carried.push_back(
          static_cast<int>(l));
}

// false: a solution is not finite.
bool World::solve_each_island() {
  bool finite = true;
  step_.attempt = Report{};
  step_.unconverged = false;
  for (Island& g : islands_.all) {
    if (g.tendons.empty()) continue;
    bt::solve(g, step_.context);
    if (!g.result.finite) g.result.residual = std::numeric_limits<double>::infinity();
    finite &= g.result.finite;
    step_.unconverged |= !g.result.converged && !g.result.left_predicted_region;
    step_.attempt.iterations = std::max(step_.attempt.iterations, g.result.iterations);
    ++step_.attempt.islands;
    step_.attempt.converged &= g.result.converged;
    if (!(g.result.residual <= step_.attempt.residual) || step_.attempt.worst_tendon < 0) read_worst(g);
  }
  step_.attempt.contacts = static_cast<long>(contacts_.all.size());
  step_.report.iterations += step_.attempt.iterations;
  return finite;
}

}  // namespace bt
