// The end of a step whose budget is exhausted, or of which the smallest substep has no finite solution.
//
// What can be solved ends the step: one substep is its rest, in which each island gets a few linear solutions
// more. Left out of it are the islands
//
//   - of which a solution has not converged in this step, or does not in that substep,
//   - that move so far that they could pass through something,
//   - that come within reach of what is left out, or sleeps.
//
// What is left out stays where it is, and keeps its velocities for the next step: it is slowed down.
// Otherwise one tangle would slow down the whole world. An island that stays and catches up would load what
// it holds with more than its share.
#include <algorithm>
#include <iterator>

#include "solver/solver.h"
#include "world/world.h"

namespace bt {

// Makes the rest of the step one substep, and leaves out what was not solved.
void World::end_early() {
  step_.solved_share = step_.substeps.share_before();
  contacts_.before = contacts_.all;
  for (Island& g : islands_.all)
    if (is_unsolved(g)) leave_out_island(g);
  step_.substeps.end_early();
  predict();
}

void World::mark_unsolved(const Island& g) {
  for (const int c : g.numbers) step_.unsolved[c] = 1;
  for (const int m : g.bodies.indices) step_.unsolved_bodies[m] = 1;
}

bool World::is_unsolved(const Island& g) const {
  return std::any_of(g.numbers.begin(), g.numbers.end(), [&](int c) { return step_.unsolved[c]; }) ||
         std::any_of(g.bodies.indices.begin(), g.bodies.indices.end(),
                     [&](int m) { return step_.unsolved_bodies[m]; });
}

// Whether anything takes part in the rest of the step.
bool World::any_moves() const {
  if (std::any_of(step_.slots.begin(), step_.slots.end(), [](const Tendon* c) { return c; })) return true;
  bool any = false;
  each_acting([&](const Element&) { any = true; });
  return any;
}

bool World::stays(const Element& element) const {
  return std::any_of(element.touched().begin(), element.touched().end(),
                     [&](const TouchedLink& touched) { return stays(scene.links[touched.link]); });
}

bool World::stays(const Link& link) const { return link.yields() && scene.bodies[link.body].stays; }

void World::leave_out_island(Island& g) {
  for (size_t m = 0; m < scene.bodies.size(); ++m)
    if (scene.bodies[m].n() > 0 && islands_.touches[m] >= 0 &&
        &islands_.all[island_root(islands_.touches[m])] == &g)
      scene.bodies[m].stays = true;
  for (size_t i = 0; i < g.tendons.size(); ++i) {
    Tendon& c = *g.tendons[i];
    c.restore_multipliers();
    for (Anchor& h : c.anchors) h.force.mean = h.force.last_mean;
    step_.slots[g.numbers[i]] = nullptr;
    step_.left_out.push_back(g.numbers[i]);
  }
  g.clear();
}

// Leaves out the islands of the last solution that would move too far. Contacts are then detected again
// without them: what moves far comes near to everything.
void World::leave_out_limited() {
  for (Island& g : islands_.all)
    if (is_limited(g)) leave_out_island(g);
}

bool World::any_limited() const {
  return std::any_of(islands_.all.begin(), islands_.all.end(),
                     [&](const Island& g) { return is_limited(g); });
}

bool World::is_limited(const Island& g) const {
  return std::any_of(g.tendons.begin(), g.tendons.end(), [](const Tendon* c) { return c->limited; }) ||
         std::any_of(g.bodies.indices.begin(), g.bodies.indices.end(),
                     [&](int m) { return scene.bodies[m].limited; });
}

// Leaves out the islands that come near to what is left out or asleep.
void World::leave_out_near() {
  find_reach();
  for (bool any = true; any;) {
    any = false;
    for (Island& g : islands_.all) {
      if (g.is_empty() || !is_near_left_out(g)) continue;
      leave_out_island(g);
      any = true;
    }
  }
}

bool World::is_near_left_out(const Island& g) const {
  for (const Contact* contact : g.contacts)
    if (contact->link >= 0 && stays(scene.links[contact->link])) return true;
  for (const int moving : g.numbers)
    for (auto [slot, c] : filled(scene.tendons))
      if (!step_.slots[slot] && meets(slot, moving)) return true;
  return false;
}

// Leaves out the islands that have no solution. leaving: those too that left their predicted region.
void World::leave_out_unsolved(bool leaving) {
  for (Island& g : islands_.all) {
    if (g.is_empty()) continue;
    const bool away = leaving && leaves_predicted_region(g);
    const bool solved = g.result.converged || (g.result.left_predicted_region && !leaving);
    if (!g.result.finite || !solved || away) leave_out_island(g);
  }
  remove_where(contacts_.all, [&](const Contact& contact) { return !step_.slots[contact.a.tendon]; });
}

// Takes back what was left out of the rest of the step: its forces are means over the time before.
void World::finish_left_out() {
  auto stayed = [&](const Contact& contact) {
    return std::find(step_.left_out.begin(), step_.left_out.end(), contact.a.tendon) != step_.left_out.end();
  };
  if (!any_moves()) contacts_.all.clear();
  std::copy_if(contacts_.before.begin(), contacts_.before.end(), std::back_inserter(contacts_.all), stayed);
  for (const int c : step_.left_out) {
    step_.slots[c] = scene.tendons[c].get();
    for (Anchor& h : step_.slots[c]->anchors) h.force.sum = (1 / step_.solved_share) * h.force.sum;
  }
  for (GeneralizedBody& m : scene.bodies)
    if (m.stays) m.leave_out(step_.solved_share, step_.substeps.step());
  count_touches();
}

}  // namespace bt
