// Steps leave out sleeping tendons until something that acts on them changes.
//
// An island falls asleep if all its tendons have been at rest for kRestTime (turning points of a swing do not
// count), if a contact or an anchor supports it, and if it touches no body that yields, because pybullet
// decides when bodies rest. Its tendons keep their state and their forces on links. Their velocities are
// zero. Its contacts are kept for reports.
//
// The whole island wakes when one of its tendons, the options or gravity change, when a link moves that it
// touches, is attached to, or has within reach, and when another tendon comes within reach. Adding or
// removing shapes and tunnels wakes all islands.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <type_traits>

#include "world/world.h"

namespace bt {

namespace {

// Largest speed of a tendon at rest, in radii per second [1/s]; and time at rest after which it sleeps [s].
// Larger speed, or less time: creep, and motion at a turning point, is stopped. Smaller speed, or more time:
// heaps, which settle ever more slowly, are solved for longer.
constexpr double kRestSpeed = 1e-5;
constexpr double kRestTime = 0.5;
// Least number of steps at rest before a tendon sleeps [-]: one long step is no rest.
constexpr int kRestSteps = 30;

// Whether no particle was faster than kRestSpeed in the last step of dt [s].
bool rests(const Tendon& c, double dt) {
  const double slow = kRestSpeed * c.radius, near = dt * slow;
  for (int k = 0; k < 3; ++k) {
    const double *x = c.x[k], *before = c.x_before[k], *v = c.v[k];
    for (int i = 0; i < c.n(); ++i)
      if (!(std::fabs(x[i] - before[i]) <= near && std::fabs(v[i]) <= slow)) return false;
  }
  return true;
}

// Whether a box in the frame `pose` on a link comes within reach [m] of a tendon in the link's step.
bool is_near(const Tendon& c, const Pose& pose, const Link& link, double dt, const Box& around,
             double reach) {
  Box box;
  double moves = 0;
  for (int i = 0; i < c.n(); ++i) {
    const Vec3 x = c.x.at(i);
    box.include(to_local(pose, x));
    moves = std::max(moves, norm(link.drift(x, dt)));
  }
  return overlap(box, around, reach + moves);
}

// Sets velocities to zero, and the history of two-step methods to the present state.
void lie_still(Tendon& c) {
  c.x_before = c.x;
  c.v.zero();
  c.v_before.zero();
  c.with_body = false;
}

double skin_of(const Tendon& c, double threshold) { return (1 + kSlack) * c.radius + threshold; }

}  // namespace

void World::wake_tendon(int tendon) {
  const int island = scene.tendons[tendon]->sleeping_island;
  scene.tendons[tendon]->quiet = 0;
  if (island < 0) return;
  for (auto [slot, c] : filled(scene.tendons))
    if (c.sleeping_island == island) {
      c.sleeping_island = -1;
      c.quiet = 0;
    }
  remove_where(contacts_.asleep,
               [&](const Contact& contact) { return scene.tendons[contact.a.tendon]->sleeping_island < 0; });
}

void World::wake_all() {
  for (auto [slot, c] : filled(scene.tendons)) wake_tendon(slot);
}

bool World::any_asleep() const {
  return std::any_of(scene.tendons.begin(), scene.tendons.end(),
                     [](const auto& c) { return c && c->sleeping_island >= 0; });
}

bool World::feels(int tendon, int slot, double dt) const {
  const Tendon& c = *scene.tendons[tendon];
  const Link& link = scene.links[slot];
  const double skin = skin_of(c, options.contact_threshold);
  for (const Anchor& h : c.anchors)
    if (h.link == slot) return true;
  for (const Contact& contact : contacts_.asleep)  // the link may be far away by now
    if (contact.link == slot && contact.a.tendon == tendon) return true;
  if (!scene.filter.meets_link(tendon, slot)) return false;
  for (auto [s, shape] : filled(scene.shapes)) {
    if (shape.link != slot) continue;
    if (shape.half_space || is_near(c, in_world(shape, link), link, dt, shape.box(), skin)) return true;
  }
  for (auto [t, tunnel] : filled(scene.tunnels))
    if (tunnel.link == slot && is_near(c, link.pose, link, dt, scene.bore_in_link(t).box, skin)) return true;
  return false;
}

// Wakes islands that changes since the last step affect.
void World::wake_disturbed(double dt) {
  if (any_asleep()) {
    if (step_.whole || !options.sleep || !same(step_.context.gravity, sleep_.gravity)) wake_all();
    for (const int l : slots_where(scene.links, [](const Link& link) { return link.moved; }))
      for (auto [slot, c] : filled(scene.tendons))
        if (c.sleeping_island >= 0 && feels(slot, l, dt)) wake_tendon(slot);
  }
  for (Link& l : scene.links) l.moved = false;
}

// Whether a tendon that moves in this substep comes within reach of one that does not.
bool World::meets(int still, int moving) const {
  const Tendon& stays = *scene.tendons[still];
  return scene.filter.meet(still, moving) &&
         overlap(sleep_.reach[moving], box_of(stays.x), skin_of(stays, 0.5 * options.contact_threshold));
}

bool World::is_met(int tendon) const {
  for (auto [slot, c] : filled(step_.slots))
    if (meets(tendon, slot)) return true;
  return false;
}

void World::find_reach() {
  sleep_.reach.assign(step_.slots.size(), Box{});
  for (auto [slot, c] : filled(step_.slots))
    sleep_.reach[slot] = box_of_reach(c, 0.5 * options.contact_threshold);
}

// Wakes islands that an awake tendon has come within reach of. Returns whether there are any.
bool World::wake_met() {
  if (!any_asleep()) return false;
  bool any = false;
  find_reach();
  for (auto [slot, c] : filled(scene.tendons))
    if (c.sleeping_island >= 0 && is_met(slot)) {
      wake_tendon(slot);
      any = true;
    }
  if (any) join_step();
  return any;
}

// Adds awake tendons to the step. The forces of tendons that wake now were constant in earlier substeps.
void World::join_step() {
  step_.slots.resize(scene.tendons.size());
  for (auto [slot, c] : filled(scene.tendons)) {
    if (step_.slots[slot] || c.sleeping_island >= 0) continue;
    step_.slots[slot] = &c;
    c.keep_multipliers();
    for (Anchor& h : c.anchors) {
      h.force.last_mean = h.force.mean;
      h.force.sum = step_.substeps.share_before() * h.force.of_step;
    }
  }
}

// Updates how long each tendon has been at rest [s]. false: none has been for kRestTime.
bool World::count_rest(double dt) {
  const bool solved = step_.substeps.taken() == 1 && step_.report.converged;
  bool any = false;
  for (auto [slot, c] : filled(step_.slots)) {
    const bool still = solved && rests(c, dt) && !c.material.tissue.relaxes();
    c.quiet = still ? c.quiet + std::min(dt, kRestTime / kRestSteps) : 0;
    any |= c.quiet >= kRestTime;
  }
  return any;
}

// Marks islands that a contact or an anchor supports (restful), and islands that touch a body that yields or
// have a tendon that has not rested long enough (restless).
void World::find_restful() {
  sleep_.restful.assign(step_.slots.size(), 0);
  sleep_.restless.assign(step_.slots.size(), 0);
  auto by = [&](int root, int link) {
    (link >= 0 && scene.links[link].yields() ? sleep_.restless : sleep_.restful)[root] = 1;
  };
  for (const Contact& contact : contacts_.all)
    if (contact.link >= 0) by(island_root(contact.a.tendon), contact.link);
  for (auto [slot, c] : filled(step_.slots)) {
    const int root = island_root(slot);
    for (const Anchor& h : c.anchors) by(root, h.link);
    if (c.quiet < kRestTime) sleep_.restless[root] = 1;
  }
}

void World::fall_asleep() {
  if (!options.sleep || !step_.substeps.divisible() || !count_rest(step_.substeps.step())) return;
  find_restful();
  for (auto [slot, c] : filled(step_.slots)) {
    const int root = island_root(slot);
    if (!sleep_.restful[root] || sleep_.restless[root]) continue;
    lie_still(c);
    c.sleeping_island = root;
  }
  auto sleeps = [&](const Contact& contact) { return scene.tendons[contact.a.tendon]->sleeping_island >= 0; };
  std::copy_if(contacts_.all.begin(), contacts_.all.end(), std::back_inserter(contacts_.asleep), sleeps);
  remove_where(contacts_.all, sleeps);
  sleep_.gravity = step_.context.gravity;
}

// Adds the constant forces of sleeping tendons to the wrenches on links.
void World::push_asleep() {
  if (!any_asleep()) return;
  for (const Contact& contact : contacts_.asleep)
    if (contact.link >= 0)
      scene.links[contact.link].apply(-contact.force.mean, contact.a.of(scene.tendons[contact.a.tendon]->x));
  for (auto [slot, c] : filled(scene.tendons))
    for (const Anchor& h : c.anchors)
      if (c.sleeping_island >= 0 && h.link >= 0)
        scene.links[h.link].apply(h.force.of_step, to_world(scene.links[h.link].pose, h.local));
}

}  // namespace bt
