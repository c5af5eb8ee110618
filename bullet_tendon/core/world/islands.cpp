// Divides the tendons into islands, and solves each island.
#include <algorithm>
#include <limits>
#include <numeric>

#include "solver/body_schur.h"
#include "solver/solver.h"
#include "world/world.h"

namespace bt {

namespace {

// Linear solutions of an island after the budget of the step is exhausted, if another one exhausted it [-].
// Larger: a budget of wall time is exceeded by more. Smaller: one tangle slows down what has contacts.
constexpr long kLastSolves = 20;

// Way from where a link was foreseen to end, over the tendon's radius, beyond which its contacts are detected
// again [-]. Larger: the plane at an edge that was foreseen elsewhere wedges the tendon. Smaller: steps with
// impacts are solved again.
constexpr double kElsewhere = 0.5;

// Whether a particle that a shape comes near to has moved farther relative to its link than contacts were
// looked for. solved: motion of the link.
bool outruns_search(const Tendon& c, const Shape& shape, const Link& link, const Twist& solved,
                    double threshold) {
  const Pose pose = in_world(shape, link);
  for (int i = 0; i < c.n(); ++i) {
    const Vec3 x = c.x.at(i);
    const double moved = norm(c.displacement.at(i) - solved.at(x - link.centre));
    if (moved <= c.slack[i] + motion_of(c, i, link)) continue;
    const Vec3 here = to_local(pose, x);
    const double reach = c.radius + threshold + c.slack[i] + moved;
    if (shape.half_space || overlap({here, here}, shape.box(), reach)) return true;
  }
  return false;
}

}  // namespace

int World::island_root(int tendon) {
  while (islands_.parent[tendon] != tendon)
    tendon = islands_.parent[tendon] = islands_.parent[islands_.parent[tendon]];
  return tendon;
}

void World::join_islands(int a, int b) {
  islands_.parent[island_root(std::max(a, b))] = island_root(std::min(a, b));
}

// Contacts and bodies join tendons to islands (union-find). Where there are elements, bodies are nodes too,
// after those of the tendons.
void World::make_islands() {
  const int tendons = static_cast<int>(step_.slots.size());
  const int count = tendons + (scene.has_elements() ? static_cast<int>(scene.bodies.size()) : 0);
  islands_.parent.resize(count);
  std::iota(islands_.parent.begin(), islands_.parent.end(), 0);
  for (const Contact& contact : contacts_.all)
    if (contact.b.tendon >= 0) join_islands(contact.a.tendon, contact.b.tendon);
  find_bodies();
  islands_.all.resize(count);
  for (int c = 0; c < count; ++c) {
    Island& g = islands_.all[c];
    g.clear();
    g.slots = &step_.slots;
    g.bodies.all = &scene.bodies;
    g.bodies.links = &scene.links;
    g.bodies.reach = step_.context.reach;
    g.bodies.freedom = 0;
    g.coupled = false;
    g.matrix.patterned = false;
    g.matrix.tolerance = 0;
    g.result = {};
  }
  for (auto [slot, c] : filled(step_.slots)) {
    Island& g = islands_.all[island_root(slot)];
    g.tendons.push_back(&c);
    g.numbers.push_back(slot);
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
      g.bodies.freedom += scene.bodies[m].n();
    }
  for (size_t l = 0; l < scene.links.size(); ++l)
    if (scene.links[l].yields() && scene.bodies[scene.links[l].body].unknowns.any)
      islands_.all[island_root(islands_.touches[scene.links[l].body])].bodies.carried.push_back(
          static_cast<int>(l));
  place_elements();
}

// Gives each element to the island of the bodies that it touches.
void World::place_elements() {
  islands_.loose.all.clear();
  if (!scene.has_elements() || step_.whole) return;
  islands_.ends.resize(scene.links.size());
  each_acting([&](Element& element) {
    IslandElements* in = &islands_.loose;
    for (const TouchedLink& touched : element.touched()) {
      const Link& link = scene.links[touched.link];
      if (link.yields() && scene.bodies[link.body].unknowns.any)
        in = &islands_.all[island_root(islands_.touches[link.body])].elements;
    }
    in->all.push_back(&element);
  });
  list_elements(islands_.loose);
  for (Island& g : islands_.all)
    if (!g.elements.all.empty()) list_elements(g.elements);
}

// Lists the links and the pairs of the elements of an island.
void World::list_elements(IslandElements& elements) {
  elements.pairs = &scene.element_pairs.all;
  elements.ends = &islands_.ends;
  elements.dt = step_.context.dt;
  elements.time = step_.substeps.end();
  elements.links.clear();
  elements.own_pairs.clear();
  for (const Element* element : elements.all) {
    const int n = static_cast<int>(element->touched().size());
    for (int i = 0; i < n; ++i) {
      elements.links.push_back(element->touched()[i].link);
      for (int j = i; j < n; ++j) elements.own_pairs.push_back(element->pair(i, j));
    }
  }
  for (std::vector<int>* list : {&elements.links, &elements.own_pairs}) {
    std::sort(list->begin(), list->end());
    list->erase(std::unique(list->begin(), list->end()), list->end());
  }
}

// A point that moves through the depth to which the distance is known, within one substep, would be lost
// behind the surface. A load that elements hold moves nothing: where its prediction would, the motion counts
// that follows under the forces of the last step, and at least that with the present velocities.
void World::limit_motion_of_cartilage() {
  for (GeneralizedBody& m : scene.bodies) m.limited = false;
  const double h = step_.context.dt;
  auto drift = [&](const Link& l) { return h * l.drift_rates; };
  auto present = [&](const Link& l) { return h * l.rates; };
  auto held = [](const Link& l) { return l.foreseen.all; };
  limit_cartilage([&](auto motion, double most) {
    const double least = motion(drift);
    return least > most ? std::min(least, std::max(motion(held), motion(present))) : least;
  });
}

// Where the solution moves a point so far, it has not felt what it passed through: beyond the depth that is
// known nothing presses, so that no force at all is a solution too.
bool World::solution_passes_cartilage() {
  auto solved = [&](const Link& l) {
    const Twist drift = step_.context.dt * l.drift_rates;
    return l.yields() ? drift + l.iterate.given : drift;
  };
  limit_cartilage([&](auto motion, double) { return motion(solved); });
  return step_.motion_limit < 1;
}

// measure(motion, most): motion of points of cartilage, by motion(twist of a link in the substep) [m], of
// which at most `most` is allowed.
template <class Measure>
void World::limit_cartilage(Measure measure) {
  if (step_.whole) return;
  for (auto [slot, part] : filled(scene.cartilages)) {
    const Cartilage& cartilage = part;
    const double most = cartilage.model().law.thickness;  // more: fast impacts pass through
    auto motion = [&](auto of) {
      return cartilage.motion(scene.links, of(scene.links[cartilage.link_a()]),
                              of(scene.links[cartilage.link_b()]), most);
    };
    const double least = measure(motion, most);
    if (least <= most) continue;
    step_.motion_limit = std::min(step_.motion_limit, most / least);
    for (const int link : {cartilage.link_a(), cartilage.link_b()})
      if (scene.links[link].yields()) scene.bodies[scene.links[link].body].limited = true;
  }
}

// A load that is held moves nothing: a link is foreseen to move under what holds it of the tendons' and
// elements' forces of the last step or substep. What they would move it by beyond that is theirs to change: a
// load that has ended is no reason to expect that a light body flies off.
void World::foresee_links() {
  static thread_local dense::Numbers y;  // keeps its memory from step to step
  const double square = step_.context.reach * step_.context.reach;
  for (Link& l : scene.links) {
    Twist given;
    if (const GeneralizedBody* m = body_of(l); m && m->touches > 0 && m->knows_last_forces()) {
      m->answer_last_forces(y);
      given = (square * m->share_that_holds(y, step_.substeps.step())) * l.spin_of(y);
    }
    l.foresee(given, step_.context.dt, turns_far(l));
  }
}

// Whether a contact that presses was detected where its link does not end: its plane is that of another
// place.
bool World::presses_elsewhere(const Contact& contact) const {
  if (contact.link < 0 || !(contact.normal_force.value > 0)) return false;
  const Link& l = scene.links[contact.link];
  return l.yields() && norm(l.displaced_from_foreseen(contact.arm)) > kElsewhere * contact.geometry.radius;
}

// Moves what is foreseen of links under their last forces to their solved motion, as predict_at_solution does
// of particles. true: a link has come near to a tendon by more than was foreseen, or presses on it elsewhere.
bool World::foresee_at_solution() {
  if (step_.detections >= kMostDetections) return false;
  const double h = step_.context.dt;
  bool any = false;
  for (const Contact& contact : contacts_.all) {
    if (!presses_elsewhere(contact)) continue;
    Link& l = scene.links[contact.link];
    l.foresee(l.iterate.given, h, turns_far(l));
    any = true;
  }
  for (auto [s, shape] : filled(scene.shapes)) {
    Link& l = scene.links[shape.link];
    if (!l.yields()) continue;
    const Twist solved = h * l.drift_rates + l.iterate.given;
    for (auto [slot, c] : filled(step_.slots)) {
      if (!scene.filter.meets_link(slot, shape.link) ||
          !outruns_search(c, shape, l, solved, options.contact_threshold))
        continue;
      l.foresee(l.iterate.given, h, turns_far(l));
      any = true;
      break;
    }
  }
  return any;
}

// Whether a solution ended with more than what holds a body may give: contacts are not to be detected for it.
bool World::overpowers() const {
  return std::any_of(islands_.all.begin(), islands_.all.end(),
                     [](const Island& g) { return g.result.overpowered; });
}

// false: a solution is not finite.
bool World::solve_each_island() {
  bool finite = true;
  step_.attempt = Report{};
  step_.unconverged = false;
  for (Island& g : islands_.all) {
    if (g.is_empty()) continue;
    const bool begun = !step_.budget.exhausted();
    step_.budget.begin_solution(begun || is_unsolved(g) ? 0 : kLastSolves);
    bt::solve(g, step_.context);
    const bool solved = g.result.finite && (g.result.converged || g.result.left_predicted_region);
    if (!solved) mark_unsolved(g);
    if (after_solution) after_solution(g, step_.context);
    if (!g.result.finite) g.result.residual = std::numeric_limits<double>::infinity();
    finite &= g.result.finite;
    step_.unconverged |= !g.result.converged && !g.result.left_predicted_region;
    step_.attempt.iterations = std::max(step_.attempt.iterations, g.result.iterations);
    ++step_.attempt.islands;
    step_.attempt.converged &= g.result.converged;
    if (!(g.result.residual <= step_.attempt.residual) || step_.attempt.worst_tendon < 0) read_worst(g);
  }
  evaluate_elements(islands_.loose, scene.links);
  step_.attempt.contacts = static_cast<long>(contacts_.all.size());
  step_.report.iterations += step_.attempt.iterations;
  return finite;
}

}  // namespace bt
