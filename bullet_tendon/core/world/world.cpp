#include "world/world.h"

#include <algorithm>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

namespace bt {

void World::ensure_link(int link) {
  if (link < static_cast<int>(links.size())) return;
  links.resize(link + 1);
  bodies.resize(link + 1);
}

int World::add_tendon(std::unique_ptr<Tendon> tendon) {
  const int slot = static_cast<int>(std::find(tendons.begin(), tendons.end(), nullptr) - tendons.begin());
  if (slot == static_cast<int>(tendons.size())) tendons.emplace_back();
  tendons[slot] = std::move(tendon);
  broad_phase_.clear();
  may_resolve_ = false;
  return slot;
}

void World::remove_tendon(int slot) {
  wake_tendon(slot);
  tendons[slot].reset();
  broad_phase_.clear();
  may_resolve_ = false;
  while (!tendons.empty() && !tendons.back()) tendons.pop_back();
  contacts_.clear();
  if (slot < static_cast<int>(caches_.size())) caches_[slot].clear();
  forget_memory_of(slot);
}

namespace {

// Into the first slot that is not alive, or a further one.
template <class Part>
int put(std::vector<Part>& parts, std::vector<char>& alive, const Part& part) {
  const size_t slot = std::find(alive.begin(), alive.end(), 0) - alive.begin();
  if (slot == alive.size()) {
    parts.emplace_back();
    alive.push_back(0);
  }
  parts[slot] = part;
  alive[slot] = 1;
  return static_cast<int>(slot);
}

// As if the part had never been there.
template <class Part>
void take(std::vector<Part>& parts, std::vector<char>& alive, int slot) {
  parts[slot] = Part{};
  alive[slot] = 0;
  while (!alive.empty() && !alive.back()) {
    parts.pop_back();
    alive.pop_back();
  }
}

}  // namespace

int World::add_shape(const Shape& shape) {
  wake_all();
  ensure_link(shape.link);
  return put(shapes, shape_alive, shape);
}

void World::remove_shape(int slot) {
  wake_all();
  take(shapes, shape_alive, slot);
  contacts_.clear();
  for (auto& of_tendon : caches_)
    if (slot < static_cast<int>(of_tendon.size())) of_tendon[slot] = NearCache{};
  forget_memory([&](const ContactKey& k) { return k.kind == ContactKind::bone && k.other == slot; });
}

int World::add_tunnel(const Tunnel& tunnel) {
  wake_all();
  ensure_link(tunnel.link);
  const int slot = put(tunnels, tunnel_alive, tunnel);
  forget_planes();
  return slot;
}

void World::remove_tunnel(int slot) {
  wake_all();
  take(tunnels, tunnel_alive, slot);
  contacts_.clear();
  forget_planes();
  for (auto& c : tendons)
    if (c) std::replace(c->tunnel_of.begin(), c->tunnel_of.end(), slot, -1);
  forget_memory([&](const ContactKey& k) {
    return (k.kind == ContactKind::bore && k.other == slot) ||
           (k.kind == ContactKind::mouth && k.other / 2 == slot);
  });
}

template <class Which>
void World::forget_memory(Which which) {
  auto gone = [&](const ContactMemory& m) { return which(m.key); };
  memory_.erase(std::remove_if(memory_.begin(), memory_.end(), gone), memory_.end());
}

void World::forget_memory_of(int tendon) {
  forget_memory([&](const ContactKey& k) {
    return k.tendon == tendon || (k.kind == ContactKind::tendon && k.other == tendon);
  });
}

// The surface inside a bore does not count, so a change of bores changes the nearest points.
void World::forget_planes() {
  for (auto& tendon_caches : caches_)
    for (auto& cache : tendon_caches) cache.entries.clear();
}

// Tendons that it is near now wake when it reaches them (wake_met).
void World::forget_contacts(int tendon) {
  wake_tendon(tendon);
  auto touches = [&](const Contact& contact) {
    return contact.a.tendon == tendon || contact.b.tendon == tendon;
  };
  contacts_.erase(std::remove_if(contacts_.begin(), contacts_.end(), touches), contacts_.end());
  forget_memory_of(tendon);
  if (tendon < static_cast<int>(caches_.size()))
    for (NearCache& cache : caches_[tendon]) cache.entries.clear();
  std::fill(tendons[tendon]->tunnel_of.begin(), tendons[tendon]->tunnel_of.end(), -1);
}

// A cache for every tendon and shape that are there.
void World::size_caches() {
  caches_.resize(tendons.size());
  for (size_t c = 0; c < tendons.size(); ++c) caches_[c].resize(tendons[c] ? shapes.size() : 0);
}

// A cache without known entries equals one of a shape that was never near: equal states have equal bytes.
void World::empty_caches() {
  auto known = [](const Entry& e) { return e.known || e.inside; };
  for (auto& of_tendon : caches_)
    for (NearCache& cache : of_tendon)
      if (std::none_of(cache.entries.begin(), cache.entries.end(), known)) cache.entries.clear();
}

// The distances of this substep: those that the core knows, and the oracle's.
void World::update_proximity(DistanceOracle& oracle) {
  queries_.clear();
  size_caches();
  for (size_t c = 0; c < tendons.size(); ++c) {
    if (!slots_[c]) continue;
    for (size_t s = 0; s < shapes.size(); ++s) {
      if (!shape_alive[s] || shapes[s].half_space) continue;
      const NearContext near{context_.dt, options.contact_threshold, options.reuse_tolerance,
                             &bores_of(shapes[s].link)};
      ask(*tendons[c], static_cast<int>(c), shapes[s], static_cast<int>(s), links[shapes[s].link], near,
          caches_[c][s], queries_, report_.near);
    }
  }
  if (queries_.empty()) return;
  oracle.measure(queries_, distances_, points_, parameters_);
  for (size_t q = 0; q < queries_.size(); ++q) {
    const Query& query = queries_[q];
    const Shape& shape = shapes[query.shape];
    Entry& entry = caches_[query.tendon][query.shape].entries[query.feature];
    answer(query, distances_[q], vec3_at(points_, q), parameters_[q], shape,
           in_world(shape, links[shape.link]), bores_of(shape.link), entry);
  }
}

}  // namespace bt
