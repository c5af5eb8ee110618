// Bodies in a step: which are unknowns of the solution, their prediction, and the forces on them.
#include <algorithm>
#include <utility>

#include "math/rounding.h"
#include "world/world.h"

namespace bt {

// Calls what(body, node) for every attachment, contact and element on a body that yields. The node joins what
// is in one island (World::make_islands): a tendon, or the first body of an element.
template <class Do>
void World::each_touch(Do what) const {
  for (auto [slot, c] : filled(step_.slots))
    for (const Anchor& h : c.anchors)
      if (h.link >= 0 && scene.links[h.link].yields()) what(scene.links[h.link].body, slot);
  for (const Contact& contact : contacts_.all)
    if (contact.link >= 0 && scene.links[contact.link].yields())
      what(scene.links[contact.link].body, contact.a.tendon);
  if (step_.whole) return;
  each_acting([&](const Element& element) {
    int node = -1;
    for (const TouchedLink& touched : element.touched()) {
      if (!scene.links[touched.link].yields()) continue;
      const int body = scene.links[touched.link].body;
      if (node < 0) node = static_cast<int>(step_.slots.size()) + body;
      what(body, node);
    }
  });
}

void World::count_touches() {
  for (GeneralizedBody& m : scene.bodies) m.touches = 0;
  each_touch([&](int body, int node) {
    ++scene.bodies[body].touches;
    // Elements act where links are at the end of the step.
    BodyTurning& turning = scene.bodies[body].turning;
    turning.elements |= node >= static_cast<int>(step_.slots.size());
    turning.far |= turning.elements;
  });
}

// Marks point masses: free rigid bodies with one attachment, at the centre of mass, and without contacts,
// shapes or tunnels.
void World::find_point_masses() {
  count_touches();
  for (GeneralizedBody& m : scene.bodies) m.point_mass = false;
  if (options.integrator == Integrator::explicit_euler) return;
  each_anchor(step_.slots, [&](const Tendon&, const Anchor& h) {
    if (h.link < 0 || h.is_line || islands_.solid[h.link] || !scene.links[h.link].yields()) return;
    const Link& link = scene.links[h.link];
    GeneralizedBody& m = scene.bodies[link.body];
    if (!link.jacobian.empty() || m.touches > 1 || m.observer.held() || m.stops.act()) return;
    const double share = m.history.share(), of_mass = 3 * share * share * m.free[0],
                 of_point = trace(link.mobility(to_world(link.pose, h.local)));
    // At the centre of mass, rotation adds nothing but rounding to the mobility.
    m.point_mass = of_point - of_mass <= kRoundingShare * of_mass;
  });
}

// All bodies that tendons touch, except point masses, are unknowns of an implicit step.
void World::find_unknowns() {
  count_touches();
  for (GeneralizedBody& m : scene.bodies)
    m.unknowns.any = m.touches > 0 && !m.point_mass && options.integrator != Integrator::explicit_euler;
  for (Link& l : scene.links) {
    l.correction = {};
    l.iterate.turned.far = false;
    if (!l.yields()) continue;
    const GeneralizedBody& m = scene.bodies[l.body];
    l.iterate.turned.far = m.unknowns.any && m.turning.far;
    if (m.unknowns.any)
      l.iterate.reached = l.root;
    else
      l.iterate.given = {};
  }
  for (Contact& contact : contacts_.all)
    contact.moves = contact.link >= 0 && scene.links[contact.link].yields() &&
                    scene.bodies[scene.links[contact.link].body].unknowns.any;
}

// Finds the island of each body that is touched. Tendons and elements that touch the same body with unknowns
// are in one island.
void World::find_bodies() {
  islands_.touches.assign(scene.bodies.size(), -1);
  each_touch([&](int body, int node) {
    if (islands_.touches[body] < 0) islands_.touches[body] = node;
    if (scene.bodies[body].unknowns.any) join_islands(islands_.touches[body], node);
  });
}

// Marks links with shapes or tunnels, and the bodies with such links that yield: tendons can touch them at
// any point.
void World::find_solid_links() {
  islands_.solid.assign(scene.links.size(), 0);
  for (auto [slot, shape] : filled(scene.shapes)) islands_.solid[shape.link] = 1;
  for (auto [slot, tunnel] : filled(scene.tunnels)) islands_.solid[tunnel.link] = 1;
  islands_.solid_bodies.assign(scene.bodies.size(), 0);
  for (size_t l = 0; l < scene.links.size(); ++l)
    if (islands_.solid[l] && scene.links[l].yields()) islands_.solid_bodies[scene.links[l].body] = 1;
}

// Computes the generalized forces of bodies from wrenches on their links, times scale.
template <class Of>
void World::sum_forces(double scale, Of wrench_of) {
  for (GeneralizedBody& m : scene.bodies) m.forces.assign(m.n(), 0.0);
  for (const Link& l : scene.links) {
    if (!l.yields()) continue;
    l.add_generalized(l.jacobian, scale * wrench_of(l), scene.bodies[l.body].forces);
  }
}

// Whether rotations of free bodies are finite in this step.
bool World::turns_finitely() const {
  return !step_.whole && options.integrator != Integrator::explicit_euler &&
         options.iteration == Iteration::newton;
}

// Marks free bodies that tendons can touch as such that turn far. The place of a contact on them moves with
// any rotation: a force where it was at the start of the step would drive on or hold back what rolls.
void World::mark_touchable_bodies() {
  if (!turns_finitely()) return;
  for (size_t l = 0; l < scene.links.size(); ++l)
    if (islands_.solid[l] && scene.links[l].yields() && scene.links[l].jacobian.empty())
      scene.bodies[scene.links[l].body].turning.far = true;
}

// Marks bodies that turn far under the forces of the last solution. Returns whether any is newly marked.
bool World::find_turning() {
  if (!turns_finitely()) return false;
  for (GeneralizedBody& m : scene.bodies) {
    m.turning.torque = {};
    m.turning.pull = m.turning.lever = 0;
  }
  auto add_pull = [&](int link, Vec3 arm, Vec3 force) {
    if (link < 0 || !scene.links[link].yields() || !scene.links[link].jacobian.empty()) return;
    GeneralizedBody& m = scene.bodies[scene.links[link].body];
    m.turning.torque += cross(arm, force);
    m.turning.pull += norm(arm) * norm(force);
    m.turning.lever = std::max(m.turning.lever, norm(arm));
  };
  each_anchor(step_.slots, [&](const Tendon&, const Anchor& h) {
    if (h.link >= 0) add_pull(h.link, scene.links[h.link].held_arm_of(h.local), h.force.total);
  });
  for (const Contact& contact : contacts_.all) add_pull(contact.link, contact.arm, -contact.force.mean);
  bool any = false;
  for (const Link& l : scene.links) {
    if (!l.yields() || !(scene.bodies[l.body].turning.lever > 0) || scene.bodies[l.body].turning.far)
      continue;
    scene.bodies[l.body].turning.far =
        scene.bodies[l.body].turns_far(l.drift_rates.angular, step_.substeps.step());
    any |= scene.bodies[l.body].turning.far;
  }
  return any;
}

// Computes the forces on bodies with this solution, averaged over the step up to its end.
void World::measure_forces() {
  measure_wrenches();
  sum_forces(1 / step_.substeps.share_at_end(), [](const Link& l) { return l.wrench + l.part; });
}

// Lets bodies yield whose hold is not trusted with the forces of this solution. Returns whether there is any.
bool World::limit_holds() {
  if (step_.whole || std::none_of(scene.bodies.begin(), scene.bodies.end(),
                                  [](const GeneralizedBody& m) { return m.observer.held(); }))
    return false;
  measure_forces();
  bool any = false;
  for (size_t m = 0; m < scene.bodies.size(); ++m) {
    GeneralizedBody& body = scene.bodies[m];
    if (body.n() == 0 || body.stays || !body.limit_hold(step_.substeps.step())) continue;
    any = true;
    body.predict(step_.substeps.step(), step_.context.gravity);
    lead_links(static_cast<int>(m));
  }
  return any;
}

// Updates joint limits, motors and contacts of bodies to the forces of this solution. Returns the reason to
// solve again if any changed. After kMostDetections changes they stay as they are, and the report tells
// whether they would change: in the last substep, because stops act evenly in the whole step.
std::optional<Reason> World::settle_stops() {
  const bool may_change = step_.stop_changes < kMostDetections;
  if (step_.whole || !(may_change || step_.substeps.is_last()) ||
      std::none_of(scene.bodies.begin(), scene.bodies.end(),
                   [](const GeneralizedBody& m) { return m.stops.any(); }))
    return {};
  measure_forces();
  if (!may_change) {
    for (GeneralizedBody& body : scene.bodies)
      step_.attempt.stops_settled &= body.stays || body.stops_settled(step_.substeps.step());
    return {};
  }
  bool other = false, yields = false;
  for (size_t m = 0; m < scene.bodies.size(); ++m) {
    GeneralizedBody& body = scene.bodies[m];
    if (body.stays || !body.settle_stops(step_.substeps.step())) continue;
    other = true;
    if (step_.substeps.taken() > 0) yields |= body.stops.let_motors_yield();
    body.history.able &= !body.stops.act();
    lead_links(static_cast<int>(m));
  }
  step_.stop_changes += other;
  if (!other) return {};
  return yields ? Reason::released : Reason::joint_stops;
}

// Applies the mean forces of the whole step to the bodies.
void World::act_on_bodies() {
  for (Link& l : scene.links) {
    if (!l.yields()) continue;
    const BodyHistory& history = scene.bodies[l.body].history;
    if (history.continues) l.wrench = l.wrench + l.history.given;
    l.history.finish(l.wrench, history.continues, history.steady_share);
  }
  sum_forces(1, [](const Link& l) { return l.wrench; });
  for (GeneralizedBody& m : scene.bodies)
    if (m.n() > 0) m.act(step_.substeps.step());
}

// After relaxation, bodies are where the last step that held them had them. What acts on them there is what
// the next step begins with.
void World::rest_bodies() {
  const bool pulled = std::any_of(scene.tendons.begin(), scene.tendons.end(), [](auto& c) { return !!c; });
  std::vector<LinkEnd> ends;
  for (Link& l : scene.links) {
    ends.push_back({l.centre, {}});
    if (!pulled) l.wrench = {};
    l.part = {};
  }
  scene.each_element([&](Element& element) {
    element.begin(scene.links, 0);
    element.evaluate(ends);
    for (const TouchedLink& touched : element.touched()) {
      Link& link = scene.links[touched.link];
      link.part = link.part + Wrench{touched.force, touched.torque};
    }
  });
  sum_forces(1, [](const Link& l) { return l.wrench + l.part; });
  for (GeneralizedBody& m : scene.bodies) {
    if (m.n() == 0) continue;
    m.history.forget();
    m.observer.rest(m.forces);
  }
}

// The body of a link that tendons move, else null.
const GeneralizedBody* World::body_of(const Link& l) const {
  return l.yields() ? &scene.bodies[l.body] : nullptr;
}

// Predicts the bodies and their links in the substep, without its forces of the tendons.
void World::lead_bodies() {
  for (GeneralizedBody& m : scene.bodies)
    if (m.n() > 0 && !step_.whole)
      m.begin_substep(step_.substeps.share_before(), step_.substeps.share_at_end());
  const double end = step_.substeps.end();
  for (Link& l : scene.links) {
    l.begin_substep(body_of(l), end - step_.context.dt, end);
    if (stays(l)) l.drift_rates = {};
    l.shifted = step_.substeps.share() * l.put;
  }
}

// Lets attachments act where their points are predicted to end, as contacts do, on links that nothing moves,
// and on links on joints, if tendons can touch them. Of a contact and an attachment that press on each other
// within a link, one at the start and one at the end would turn it, and give it energy.
void World::foresee_ends() {
  if (!turns_finitely()) return;
  auto acts_at_end = [&](size_t k) {
    const Link& l = scene.links[k];
    if (!l.yields()) return islands_.solid[k] != 0;
    return !l.jacobian.empty() && islands_.solid_bodies[l.body] && !scene.bodies[l.body].history.admitted;
  };
  for (size_t k = 0; k < scene.links.size(); ++k) {
    if (!acts_at_end(k)) continue;
    Link& l = scene.links[k];
    l.attachment_arms = {true, rotation_of_step(step_.context.dt * l.rates.angular)};
  }
}

// Adds the impulse of the solved substep to the bodies' rates, and moves their links to its end.
void World::push_bodies() {
  sum_forces(step_.substeps.step(), [](const Link& l) { return l.part; });
  for (GeneralizedBody& m : scene.bodies) {
    if (m.n() == 0 || step_.whole) continue;
    m.push(m.forces, step_.context.dt);
    m.begin_substep(step_.substeps.share_before(), step_.substeps.share_at_end());
  }
  for (Link& l : scene.links) l.advance_to(body_of(l), step_.substeps.end());
}

void World::sense(double dt, Vec3 gravity, bool held) {
  step_.context.dt = dt;
  step_.context.gravity = gravity;
  for (Link& l : scene.links) {
    l.note_motion();
    if (held) l.put = {};
    l.start = {l.pose, l.centre, true};
    if (held) l.body = -1;
    if (l.yields()) continue;
    l.drift_rates = held ? Twist{} : l.rates;
  }
  if (held) return;
  for (Link& l : scene.links)
    if (std::exchange(l.yielded, l.yields()) != l.yields()) interrupt();
  for (GeneralizedBody& m : scene.bodies)
    if (m.n() > 0) {
      m.sense();
      m.predict(dt, gravity);
    }
  for (Link& l : scene.links)
    if (l.yields()) l.go_with(scene.bodies[l.body]);
}

void World::predict(int body) {
  if (scene.bodies[body].n() == 0) return;
  scene.bodies[body].predict(step_.context.dt, step_.context.gravity);
  lead_links(body);
}

void World::lead_links(int body) {
  for (Link& l : scene.links)
    if (l.body == body) l.go_with(scene.bodies[body]);
}

void World::finish_resolve() {
  for (GeneralizedBody& m : scene.bodies) {
    m.observer.refresh(m.rates);
    m.observer.resume();
    m.stops.motors.again = false;
  }
  history_.may_resolve = false;
  capture(*history_.now);
}

}  // namespace bt
