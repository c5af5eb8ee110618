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

// what(mover, weight, tendon) for every attachment and every contact of a body that yields. An attachment of
// a rigid body that nothing holds weighs 1, all else 2.
template <class Do>
void World::each_touch(Do what) const {
  for (size_t c = 0; c < slots_.size(); ++c)
    for (size_t i = 0; slots_[c] && i < slots_[c]->holds.size(); ++i) {
      const Hold& h = slots_[c]->holds[i];
      if (h.link < 0 || !links[h.link].yields()) continue;
      const int mover = links[h.link].mover;
      const Mover& m = movers[mover];
      const bool loose = links[h.link].jacobian.empty() && !m.observer.held() && !m.is_stopped() && !m.turns;
      what(mover, loose ? 1 : 2, static_cast<int>(c));
    }
  for (const Row& row : rows_)
    if (row.link >= 0 && links[row.link].yields()) what(links[row.link].mover, 2, row.a.chain);
}

// All that tendons touch, but free rigid bodies that one attachment has for itself, which a spring stands for
// exactly (aim_attachments). What joints or else block would make that spring stiff without end. true: these
// are other ones than before, and attachments have to be aimed anew.
bool World::find_unknowns() {
  touches_.assign(movers.size(), 0);
  each_touch([&](int mover, int weight, int) { touches_[mover] += weight; });
  bool other = false;
  for (size_t m = 0; m < movers.size(); ++m) {
    const bool unknown = touches_[m] > 1 && options.integrator != Integrator::explicit_euler;
    other |= unknown != movers[m].unknown;
    movers[m].unknown = unknown;
  }
  for (Link& l : links) l.turned.far = l.yields() && movers[l.mover].unknown && movers[l.mover].turns;
  for (Row& row : rows_)
    row.moves = row.link >= 0 && links[row.link].yields() && movers[links[row.link].mover].unknown;
  return other;
}

// The unknown bodies of every group, whose tendons are solved together.
void World::find_bodies() {
  touches_.assign(movers.size(), -1);
  each_touch([&](int mover, int, int chain) {
    if (!movers[mover].unknown) return;
    if (touches_[mover] < 0) touches_[mover] = chain;
    join_groups(touches_[mover], chain);
  });
}

// Links that tendons can touch anywhere.
std::vector<char> World::solid_links() const {
  std::vector<char> solid(links.size());
  for (size_t s = 0; s < shapes.size(); ++s)
    if (shape_alive[s]) solid[shapes[s].link] = 1;
  for (size_t t = 0; t < tunnels.size(); ++t)
    if (tunnel_alive[t]) solid[tunnels[t].link] = 1;
  for (const Row& row : rows_)
    if (row.link >= 0) solid[row.link] = 1;
  return solid;
}

// The unknowns of bodies, by what can touch them: a link with shapes or tunnels anywhere, else its attached
// points alone.
void World::narrow_bodies() {
  if (std::none_of(movers.begin(), movers.end(), [](const Mover& m) { return m.unknown; })) return;
  const std::vector<char> solid = solid_links();
  auto each_reached = [&](auto what) {  // what(link, number of directions, arm)
    for (size_t l = 0; l < links.size(); ++l)
      if (solid[l] && links[l].yields()) what(links[l], 6, Vec3{});
    for (const Chain* c : slots_)
      for (size_t h = 0; c && h < c->holds.size(); ++h) {
        const Hold& hold = c->holds[h];
        if (hold.link < 0 || solid[hold.link] || !links[hold.link].yields()) continue;
        const Link& link = links[hold.link];
        what(link, 3, to_world(link.pose, hold.local) - link.centre);
      }
  };
  for (Mover& m : movers) m.freedom = 0, m.basis.clear();
  each_reached([&](const Link& link, int count, Vec3) { movers[link.mover].freedom += count; });
  for (Mover& m : movers) m.freedom = !m.unknown || m.turns || m.freedom >= m.n() ? m.n() : 0;
  each_reached([&](const Link& link, int count, Vec3 arm) {
    Mover& m = movers[link.mover];
    for (int k = 0; k < count && m.freedom < m.n(); ++k) m.widen(link.motion_of(k, arm));
  });
  for (Link& l : links)
    if (l.yields() && movers[l.mover].unknown) l.reach(movers[l.mover]);
}

// Generalized forces of the wrenches on links, of the whole step or of the part that was solved last.
void World::sum_forces(double scale, bool of_part) {
  for (Mover& m : movers) m.forces.assign(m.n(), 0.0);
  for (Link& l : links) {
    if (!l.yields()) continue;
    const Vec3 force = of_part ? l.force - l.before_force : l.force;
    const Vec3 torque = of_part ? l.torque - l.before_torque : l.torque;
    l.add_generalized(l.jacobian, {scale * force, scale * torque}, movers[l.mover].forces);
  }
}

// Marks bodies that turn far, by the forces of the last solution. true: one that was not marked.
bool World::find_turning() {
  if (whole_ || options.integrator == Integrator::explicit_euler || options.iteration == Iteration::single)
    return false;
  for (Mover& m : movers) m.torque = {}, m.pull = 0;
  auto add_pull = [&](int link, Vec3 arm, Vec3 force) {
    if (link < 0 || !links[link].yields() || !links[link].jacobian.empty()) return;
    Mover& m = movers[links[link].mover];
    m.torque += cross(arm, force), m.pull += norm(arm) * norm(force);
  };
  for (const Chain* c : slots_)
    for (size_t i = 0; c && i < c->holds.size(); ++i)
      if (const Hold& h = c->holds[i]; h.link >= 0) add_pull(h.link, links[h.link].arm_of(h.local), h.force);
  for (const Row& row : rows_) add_pull(row.link, row.arm, -row.mean_force);
  bool any = false;
  for (const Link& l : links) {
    if (!l.yields() || !(movers[l.mover].pull > 0) || movers[l.mover].turns) continue;
    movers[l.mover].turns = movers[l.mover].turns_far(l.spin, whole_dt_);
    any |= movers[l.mover].turns;
  }
  return any;
}

// Whether limits and contacts act with the forces of this solution that were not foreseen to, or the other
// way.
bool World::settle_stops() {
  if (whole_ || settlings_ >= kSettlings ||
      std::none_of(movers.begin(), movers.end(), [](const Mover& m) { return m.may_stop(); }))
    return false;
  push_links(substeps_.share());
  sum_forces(1 / substeps_.share_at_end(), false);
  for (Link& l : links) l.force = l.before_force, l.torque = l.before_torque;
  bool other = false;
  for (size_t m = 0; m < movers.size(); ++m) {
    if (!movers[m].may_stop() || !movers[m].settle_stops(movers[m].forces, whole_dt_)) continue;
    other = true;
    lead_links(static_cast<int>(m));
  }
  settlings_ += other;
  return other;
}

// What the part that was solved did to the bodies, in the parts to come.
void World::push_bodies() {
  sum_forces(whole_dt_, true);
  for (Mover& m : movers)
    if (m.n() > 0) m.push(m.forces);
  for (Link& l : links)
    if (l.yields()) l.follow(movers[l.mover]);
}

void World::sense(double dt, Vec3 gravity, bool held) {
  context_.dt = dt, context_.gravity = gravity;
  for (Link& l : links) {
    l.note_motion();
    l.start_pose = l.pose, l.start_centre = l.centre;
    if (held) l.mover = -1;
    if (l.yields()) continue;
    l.velocity = held ? Vec3{} : l.now_velocity, l.spin = held ? Vec3{} : l.now_spin;
  }
  if (held) return;
  for (Link& l : links)
    if (std::exchange(l.yielded, l.yields()) != l.yields()) interrupt();
  for (Mover& m : movers)
    if (m.n() > 0) m.sense(gravity), m.foresee(dt, gravity);
  for (Link& l : links)
    if (l.yields()) l.go_with(movers[l.mover]);
}

bool World::note(int mover, const dense::Numbers& rates) {
  return movers[mover].note(rates, context_.gravity);
}

void World::foresee(int mover) {
  if (movers[mover].n() == 0) return;
  movers[mover].foresee(context_.dt, context_.gravity);
  lead_links(mover);
}

void World::lead_links(int mover) {
  for (Link& l : links)
    if (l.mover == mover) l.go_with(movers[mover]);
}

bool World::any_held() const {
  for (const Mover& m : movers)
    if (m.observer.held()) return true;
  return false;
}

void World::refresh_movers() {
  for (Mover& m : movers) m.observer.refresh(m.rates), m.observer.doubt();
  way_back_ = false;
}

}  // namespace bt
