#include "world/world.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

namespace bt {

void World::ensure_link(int link) {
  if (link < static_cast<int>(scene.links.size())) return;
  scene.links.resize(link + 1);
  scene.bodies.resize(link + 1);
}

int World::add_tendon(std::unique_ptr<Tendon> tendon) {
  detection_.broad_phase.clear();
  history_.may_resolve = false;
  const int slot = scene.tendons.add(std::move(tendon));
  drill_surfaces();
  return slot;
}

void World::remove_tendon(int slot) {
  wake_tendon(slot);
  scene.tendons.remove(slot);
  detection_.broad_phase.clear();
  history_.may_resolve = false;
  contacts_.all.clear();
  if (slot < static_cast<int>(detection_.caches.size())) detection_.caches[slot].clear();
  forget_memory_of(slot);
  scene.filter.forget_tendon(slot);
}

int World::add_shape(const Shape& shape) {
  wake_all();
  ensure_link(shape.link);
  return scene.shapes.add(std::make_unique<Shape>(shape));
}

void World::remove_shape(int slot) {
  wake_all();
  scene.shapes.remove(slot);
  contacts_.all.clear();
  for (auto& of_tendon : detection_.caches)
    if (slot < static_cast<int>(of_tendon.size())) of_tendon[slot] = NearCache{};
  if (slot < static_cast<int>(detection_.drilled.size())) detection_.drilled[slot].clear();
  forget_memory([&](const ContactKey& k) { return k.kind == ContactKind::bone && k.other == slot; });
}

int World::add_tunnel(const Tunnel& tunnel) {
  wake_all();
  ensure_link(tunnel.link);
  const int slot = scene.tunnels.add(std::make_unique<Tunnel>(tunnel));
  forget_planes();
  return slot;
}

void World::set_mouths(int slot, const Vec3 (&centre)[2], const Vec3 (&slope)[2]) {
  wake_all();
  Tunnel& tunnel = *scene.tunnels[slot];
  tunnel.start = centre[0];
  tunnel.end = centre[1];
  tunnel.start_slope = slope[0];
  tunnel.end_slope = slope[1];
  forget_planes();
  drill_surfaces();
}

void World::remove_tunnel(int slot) {
  wake_all();
  scene.tunnels.remove(slot);
  contacts_.all.clear();
  forget_planes();
  for (auto [tendon, c] : filled(scene.tendons)) c.leave_bore(slot);
  forget_memory([&](const ContactKey& k) {
    return (k.kind == ContactKind::bore && k.other == slot) ||
           (k.kind == ContactKind::mouth && k.other / 2 == slot);
  });
}

template <class Which>
void World::forget_memory(Which which) {
  remove_where(contacts_.memory, [&](const ContactMemory& m) { return which(m.key); });
}

void World::forget_memory_of(int tendon) {
  forget_memory([&](const ContactKey& k) {
    return k.tendon == tendon || (k.kind == ContactKind::tendon && k.other == tendon);
  });
}

// Deletes what is remembered of contacts that the filter excludes. The last step is not solved again, because
// it had other contacts.
void World::filter_contacts(std::initializer_list<int> tendons,
                            const std::function<void(CollisionFilter&)>& change) {
  for (int tendon : tendons) wake_tendon(tendon);
  change(scene.filter);
  history_.may_resolve = false;
  detection_.broad_phase.clear();
  forget_memory([&](const ContactKey& k) {
    switch (k.kind) {
      case ContactKind::tendon:
        return !scene.filter.meet(k.tendon, k.other);
      case ContactKind::bone:
        return !scene.filter.meets_link(k.tendon, scene.shapes[k.other]->link);
      case ContactKind::bore:
        return !scene.filter.meets_link(k.tendon, scene.tunnels[k.other]->link);
      case ContactKind::mouth:
        return !scene.filter.meets_link(k.tendon, scene.tunnels[k.other / 2]->link);
    }
    return false;
  });
}

// Deletes all cached planes. Surfaces inside a bore are ignored, so that a new set of bores changes the
// nearest points.
void World::forget_planes() {
  detection_.drilled.clear();
  for (auto& tendon_caches : detection_.caches)
    for (auto& cache : tendon_caches) cache.entries.clear();
}

// Sleeping tendons near its new position wake in wake_met.
void World::forget_contacts(int tendon) {
  wake_tendon(tendon);
  remove_where(contacts_.all, [&](const Contact& contact) {
    return contact.a.tendon == tendon || contact.b.tendon == tendon;
  });
  forget_memory_of(tendon);
  if (tendon < static_cast<int>(detection_.caches.size()))
    for (NearCache& cache : detection_.caches[tendon]) cache.entries.clear();
  scene.tendons[tendon]->leave_bores();
}

// Makes a cache for every pair of tendon and shape.
void World::size_caches() {
  detection_.caches.resize(scene.tendons.size());
  for (size_t c = 0; c < scene.tendons.size(); ++c)
    detection_.caches[c].resize(scene.tendons[c] ? scene.shapes.size() : 0);
}

// Empties caches without known entries, so that they equal caches of shapes that were never near: equal
// states have equal bytes.
void World::empty_caches() {
  auto known = [](const Entry& e) { return e.known || e.inside; };
  for (auto& of_tendon : detection_.caches)
    for (NearCache& cache : of_tendon)
      if (std::none_of(cache.entries.begin(), cache.entries.end(), known)) cache.entries.clear();
}

const std::vector<Bore>& World::bores_for(const Tendon& c, int link) {
  const std::vector<Bore>& all = detection_.bores_by_link[link];
  auto is_narrow = [&](const Bore& b) { return b.radius <= c.radius; };
  if (std::none_of(all.begin(), all.end(), is_narrow)) return all;
  detection_.wide_bores.clear();
  std::remove_copy_if(all.begin(), all.end(), std::back_inserter(detection_.wide_bores), is_narrow);
  return detection_.wide_bores;
}

const Surface* World::surface_for(const Tendon& c, int s) {
  const Shape& shape = *scene.shapes[s];
  if (!shape.surface) return nullptr;
  std::vector<int>& wide = detection_.wide_tunnels;
  wide.clear();
  for (auto [t, tunnel] : filled(scene.tunnels))
    if (tunnel.link == shape.link && tunnel.radius > c.radius) wide.push_back(t);
  if (wide.empty()) return shape.surface.get();
  detection_.drilled.resize(scene.shapes.size());
  std::vector<DrilledMesh>& known = detection_.drilled[s];
  const auto found =
      std::find_if(known.begin(), known.end(), [&](const DrilledMesh& d) { return d.tunnels == wide; });
  if (found != known.end()) return found->left.get();
  const Rot3 turn = transposed(shape.local.rotation);
  std::vector<Triangle> left = shape.surface->triangles();
  for (const int t : wide)
    left = drilled(left, in_world(*scene.tunnels[t], {turn, -(turn * shape.local.origin)}));
  known.push_back({wide, std::make_unique<const Surface>(std::move(left))});
  return known.back().left.get();
}

void World::drill_surfaces() {
  for (auto [tendon, c] : filled(scene.tendons))
    for (auto [s, shape] : filled(scene.shapes))
      if (scene.filter.meets_link(tendon, shape.link)) surface_for(c, s);
}

NearContext World::near_context(const Tendon& c, int s) {
  return {options.contact_threshold,
          options.reuse_tolerance,
          {},
          &bores_for(c, scene.shapes[s]->link),
          surface_for(c, s),
          &scene.links};
}

void World::find_pressed(int tendon, int s) {
  detection_.pressed.clear();
  for (const ContactMemory& m : contacts_.memory)
    if (m.key.kind == ContactKind::bone && m.key.tendon == tendon && m.key.other == s)
      detection_.pressed.push_back(m.key.feature);
}

// Updates the distances of this substep: from the cache or the core where possible, otherwise from the
// oracle.
void World::update_proximity(DistanceOracle& oracle) {
  detection_.queries.clear();
  size_caches();
  for (auto [tendon, c] : filled(step_.slots)) {
    const Box reach = box_of_reach(c, options.contact_threshold);
    for (auto [s, shape] : filled(scene.shapes)) {
      NearCache& cache = detection_.caches[tendon][s];
      if (shape.half_space) continue;
      if (scene.filter.meets_link(tendon, shape.link)) {
        NearContext context = near_context(c, s);
        context.reach = reach;
        if (!context.bores->empty()) {
          find_pressed(tendon, s);
          context.pressed = &detection_.pressed;
        }
        ask(c, tendon, shape, s, context, cache, detection_.queries, step_.report.near);
      } else {
        cache.entries.clear();
      }
    }
  }
  const std::vector<Query>& queries = detection_.queries.by_oracle;
  if (!queries.empty())
    oracle.measure(queries, detection_.distances, detection_.points, detection_.parameters);
  for (size_t q = 0; q < queries.size(); ++q) {
    const Query& query = queries[q];
    const Shape& shape = *scene.shapes[query.shape];
    Entry& entry = detection_.caches[query.tendon][query.shape].entries[query.feature];
    answer(query, detection_.distances[q], detection_.points[q], detection_.parameters[q],
           in_world(shape, scene.links[shape.link]), near_context(*scene.tendons[query.tendon], query.shape),
           entry);
  }
  for (const Query& query : detection_.queries.from_ends)
    measure_from_ends(query, *scene.shapes[query.shape]->surface,
                      detection_.caches[query.tendon][query.shape]);
  for (auto [tendon, c] : filled(step_.slots))
    for (auto [s, shape] : filled(scene.shapes))
      if (shape.solid) leave_out_insertions(c, shape, bores_for(c, shape.link), detection_.caches[tendon][s]);
}

}  // namespace bt
