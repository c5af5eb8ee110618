// Which bodies' coordinates are unknowns of the solution, and what parts of a step do to them.
#include <algorithm>
#include <utility>
#include <vector>

#include "world/world.h"

namespace bt {

namespace {

// A part of a step is solved again at most this often because other limits and contacts act than foreseen.
constexpr int kSettlings = 8;

}  // namespace

// what(body, tendon) for every attachment and every contact of a body that yields.
template <class Do>
void World::each_touch(Do what) const {
  for (size_t c = 0; c < slots_.size(); ++c)
    for (size_t i = 0; slots_[c] && i < slots_[c]->anchors.size(); ++i) {
      const Anchor& h = slots_[c]->anchors[i];
      if (h.link >= 0 && links[h.link].yields()) what(links[h.link].body, static_cast<int>(c));
    }
  for (const Contact& contact : contacts_)
    if (contact.link >= 0 && links[contact.link].yields()) what(links[contact.link].body, contact.a.tendon);
}

// All bodies that tendons touch are unknowns of an implicit step.
void World::find_unknowns() {
  for (GeneralizedBody& m : bodies) m.unknown = false;
  if (options.integrator != Integrator::explicit_euler)
    each_touch([&](int body, int) { bodies[body].unknown = true; });
  for (Link& l : links) l.turned.far = l.yields() && bodies[l.body].unknown && bodies[l.body].turns;
  for (Contact& contact : contacts_)
    contact.moves =
        contact.link >= 0 && links[contact.link].yields() && bodies[links[contact.link].body].unknown;
}

// The unknown bodies of every island, whose tendons are solved together.
void World::find_bodies() {
  touches_.assign(bodies.size(), -1);
  each_touch([&](int body, int tendon) {
    if (!bodies[body].unknown) return;
    if (touches_[body] < 0) touches_[body] = tendon;
    join_islands(touches_[body], tendon);
  });
}

// Links that tendons can touch anywhere.
std::vector<char> World::solid_links() const {
  std::vector<char> solid(links.size());
  for (size_t s = 0; s < shapes.size(); ++s)
    if (shape_alive[s]) solid[shapes[s].link] = 1;
  for (size_t t = 0; t < tunnels.size(); ++t)
    if (tunnel_alive[t]) solid[tunnels[t].link] = 1;
  for (const Contact& contact : contacts_)
    if (contact.link >= 0) solid[contact.link] = 1;
  return solid;
}

// The unknowns of bodies, by what can touch them: a link with shapes or tunnels anywhere, else its attached
// points alone.
void World::narrow_bodies() {
  if (std::none_of(bodies.begin(), bodies.end(), [](const GeneralizedBody& m) { return m.unknown; })) return;
  const std::vector<char> solid = solid_links();
  auto each_reached = [&](auto what) {  // what(link, number of directions, arm)
    for (size_t l = 0; l < links.size(); ++l)
      if (solid[l] && links[l].yields()) what(links[l], 6, Vec3{});
    for (const Tendon* c : slots_)
      for (size_t h = 0; c && h < c->anchors.size(); ++h) {
        const Anchor& anchor = c->anchors[h];
        if (anchor.link < 0 || solid[anchor.link] || !links[anchor.link].yields()) continue;
        const Link& link = links[anchor.link];
        what(link, 3, to_world(link.pose, anchor.local) - link.centre);
      }
  };
  for (GeneralizedBody& m : bodies) m.freedom = 0, m.basis.clear();
  each_reached([&](const Link& link, int count, Vec3) { bodies[link.body].freedom += count; });
  for (GeneralizedBody& m : bodies) m.freedom = !m.unknown || m.turns || m.freedom >= m.n() ? m.n() : 0;
  each_reached([&](const Link& link, int count, Vec3 arm) {
    GeneralizedBody& m = bodies[link.body];
    for (int k = 0; k < count && m.freedom < m.n(); ++k) m.widen(link.motion_of(k, arm));
  });
  for (Link& l : links)
    if (l.yields() && bodies[l.body].unknown) l.reach(bodies[l.body]);
}

// Generalized forces of the wrenches on links, of the whole step or of the part that was solved last.
void World::sum_forces(double scale, bool of_part) {
  for (GeneralizedBody& m : bodies) m.forces.assign(m.n(), 0.0);
  for (Link& l : links) {
    if (!l.yields()) continue;
    const Vec3 force = of_part ? l.force - l.before_force : l.force;
    const Vec3 torque = of_part ? l.torque - l.before_torque : l.torque;
    l.add_generalized(l.jacobian, {scale * force, scale * torque}, bodies[l.body].forces);
  }
}

// Marks bodies that turn far, by the forces of the last solution. true: one that was not marked.
bool World::find_turning() {
  if (whole_ || options.integrator == Integrator::explicit_euler || options.iteration == Iteration::single)
    return false;
  for (GeneralizedBody& m : bodies) m.torque = {}, m.pull = 0;
  auto add_pull = [&](int link, Vec3 arm, Vec3 force) {
    if (link < 0 || !links[link].yields() || !links[link].jacobian.empty()) return;
    GeneralizedBody& m = bodies[links[link].body];
    m.torque += cross(arm, force), m.pull += norm(arm) * norm(force);
  };
  for (const Tendon* c : slots_)
    for (size_t i = 0; c && i < c->anchors.size(); ++i)
      if (const Anchor& h = c->anchors[i]; h.link >= 0)
        add_pull(h.link, links[h.link].arm_of(h.local), h.force);
  for (const Contact& contact : contacts_) add_pull(contact.link, contact.arm, -contact.mean_force);
  bool any = false;
  for (const Link& l : links) {
    if (!l.yields() || !(bodies[l.body].pull > 0) || bodies[l.body].turns) continue;
    bodies[l.body].turns = bodies[l.body].turns_far(l.spin, whole_dt_);
    any |= bodies[l.body].turns;
  }
  return any;
}

// Whether limits and contacts act with the forces of this solution that were not foreseen to, or the other
// way.
bool World::settle_stops() {
  if (whole_ || settlings_ >= kSettlings ||
      std::none_of(bodies.begin(), bodies.end(), [](const GeneralizedBody& m) { return m.may_stop(); }))
    return false;
  push_links(substeps_.share());
  sum_forces(1 / substeps_.share_at_end(), false);
  for (Link& l : links) l.force = l.before_force, l.torque = l.before_torque;
  bool other = false;
  for (size_t m = 0; m < bodies.size(); ++m) {
    if (!bodies[m].may_stop() || !bodies[m].settle_stops(bodies[m].forces, whole_dt_)) continue;
    other = true;
    lead_links(static_cast<int>(m));
  }
  settlings_ += other;
  return other;
}

// What the part that was solved did to the bodies, in the parts to come.
void World::push_bodies() {
  sum_forces(whole_dt_, true);
  for (GeneralizedBody& m : bodies)
    if (m.n() > 0) m.push(m.forces);
  for (Link& l : links)
    if (l.yields()) l.follow(bodies[l.body]);
}

void World::sense(double dt, Vec3 gravity, bool held) {
  context_.dt = dt, context_.gravity = gravity;
  for (Link& l : links) {
    l.note_motion();
    l.start_pose = l.pose, l.start_centre = l.centre;
    if (held) l.body = -1;
    if (l.yields()) continue;
    l.velocity = held ? Vec3{} : l.now_velocity, l.spin = held ? Vec3{} : l.now_spin;
  }
  if (held) return;
  for (Link& l : links)
    if (std::exchange(l.yielded, l.yields()) != l.yields()) interrupt();
  for (GeneralizedBody& m : bodies)
    if (m.n() > 0) m.sense(gravity), m.predict(dt, gravity);
  for (Link& l : links)
    if (l.yields()) l.go_with(bodies[l.body]);
}

bool World::note(int body, const dense::Numbers& rates) { return bodies[body].note(rates, context_.gravity); }

void World::predict(int body) {
  if (bodies[body].n() == 0) return;
  bodies[body].predict(context_.dt, context_.gravity);
  lead_links(body);
}

void World::lead_links(int body) {
  for (Link& l : links)
    if (l.body == body) l.go_with(bodies[body]);
}

bool World::any_held() const {
  for (const GeneralizedBody& m : bodies)
    if (m.observer.held()) return true;
  return false;
}

void World::refresh_bodies() {
  for (GeneralizedBody& m : bodies) m.observer.refresh(m.rates), m.observer.doubt();
  way_back_ = false;
}

}  // namespace bt
