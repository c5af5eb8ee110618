#include "world/world.h"

#include <algorithm>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

namespace bt {

int World::add_chain(std::unique_ptr<Chain> chain) {
  const int slot = static_cast<int>(std::find(chains.begin(), chains.end(), nullptr) - chains.begin());
  if (slot == static_cast<int>(chains.size())) chains.emplace_back();
  chains[slot] = std::move(chain);
  broad_phase_.clear();
  way_back_ = false;
  return slot;
}

void World::remove_chain(int slot) {
  rouse(slot);
  chains[slot].reset();
  broad_phase_.clear();
  way_back_ = false;
  while (!chains.empty() && !chains.back()) chains.pop_back();
  rows_.clear();
  if (slot < static_cast<int>(caches_.size())) caches_[slot].clear();
  forget_memory_of(slot);
}

namespace {

// Into the first slot that is not alive, or a further one.
template <class Part>
int put(std::vector<Part>& parts, std::vector<char>& alive, const Part& part) {
  const size_t slot = std::find(alive.begin(), alive.end(), 0) - alive.begin();
  if (slot == alive.size()) parts.emplace_back(), alive.push_back(0);
  parts[slot] = part, alive[slot] = 1;
  return static_cast<int>(slot);
}

// Leaves no trace: as if the part had never been there.
template <class Part>
void take(std::vector<Part>& parts, std::vector<char>& alive, int slot) {
  parts[slot] = Part{}, alive[slot] = 0;
  while (!alive.empty() && !alive.back()) parts.pop_back(), alive.pop_back();
}

}  // namespace

int World::add_shape(const Shape& shape) {
  rouse_all();
  return put(shapes, shape_alive, shape);
}

void World::remove_shape(int slot) {
  rouse_all();
  take(shapes, shape_alive, slot);
  rows_.clear();
  for (auto& of_chain : caches_)
    if (slot < static_cast<int>(of_chain.size())) of_chain[slot] = NearCache{};
  forget_memory([&](const ContactKey& k) { return k.kind == ContactKind::bone && k.other == slot; });
}

int World::add_tunnel(const Tunnel& tunnel) {
  rouse_all();
  const int slot = put(tunnels, tunnel_alive, tunnel);
  forget_planes();
  return slot;
}

void World::remove_tunnel(int slot) {
  rouse_all();
  take(tunnels, tunnel_alive, slot);
  rows_.clear();
  forget_planes();
  for (auto& c : chains)
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

void World::forget_memory_of(int chain) {
  forget_memory([&](const ContactKey& k) {
    return k.tendon == chain || (k.kind == ContactKind::tendon && k.other == chain);
  });
}

// What was bone may be bore now, and the other way round.
void World::forget_planes() {
  for (auto& chain_caches : caches_)
    for (auto& cache : chain_caches) cache.entries.clear();
}

// What it has come near to instead wakes when it is met (rouse_met).
void World::forget_contacts(int chain) {
  rouse(chain);
  auto touches = [&](const Row& row) { return row.a.chain == chain || row.b.chain == chain; };
  rows_.erase(std::remove_if(rows_.begin(), rows_.end(), touches), rows_.end());
  forget_memory_of(chain);
  if (chain < static_cast<int>(caches_.size()))
    for (NearCache& cache : caches_[chain]) cache.entries.clear();
  std::fill(chains[chain]->tunnel_of.begin(), chains[chain]->tunnel_of.end(), -1);
}

// A link, of a body that nothing moves, for all that refers to one: pybullet may not have told of it yet.
void World::size_links() {
  size_t count = links.size();
  auto need = [&](int link) { count = std::max(count, static_cast<size_t>(link + 1)); };
  for (const auto& c : chains)
    for (size_t h = 0; c && h < c->holds.size(); ++h) need(c->holds[h].link);
  for (size_t s = 0; s < shapes.size(); ++s)
    if (shape_alive[s]) need(shapes[s].link);
  for (size_t t = 0; t < tunnels.size(); ++t)
    if (tunnel_alive[t]) need(tunnels[t].link);
  links.resize(count);
  movers.resize(std::max(movers.size(), count));
}

// A cache for every tendon and shape that are there.
void World::size_caches() {
  caches_.resize(chains.size());
  for (size_t c = 0; c < chains.size(); ++c) caches_[c].resize(chains[c] ? shapes.size() : 0);
}

// Of which nothing is known as of those that were never near: equal states have equal bytes.
void World::empty_caches() {
  auto known = [](const Entry& e) { return e.known || e.inside; };
  for (auto& of_chain : caches_)
    for (NearCache& cache : of_chain)
      if (std::none_of(cache.entries.begin(), cache.entries.end(), known)) cache.entries.clear();
}

// The distances of this substep: those that the core knows, and the oracle's.
void World::update_proximity(DistanceOracle& oracle) {
  queries_.clear();
  size_caches();
  for (size_t c = 0; c < chains.size(); ++c) {
    if (!slots_[c]) continue;
    for (size_t s = 0; s < shapes.size(); ++s) {
      if (!shape_alive[s] || shapes[s].half_space) continue;
      NearContext near{context_.dt, options.contact_threshold, options.reuse_tolerance,
                       &bores_of(shapes[s].link), &changed_entries_};
      ask(*chains[c], static_cast<int>(c), shapes[s], static_cast<int>(s), links[shapes[s].link], near,
          caches_[c][s], queries_, report_.near);
    }
  }
  if (queries_.empty()) return;
  oracle.measure(queries_, distances_, points_, parameters_);
  for (size_t q = 0; q < queries_.size(); ++q) {
    const Query& query = queries_[q];
    const Shape& shape = shapes[query.shape];
    Entry& entry = caches_[query.chain][query.shape].entries[query.feature];
    changed_entries_.push_back({query.chain, query.shape, query.feature, entry});
    answer(query, distances_[q], vec3_at(points_, q), parameters_[q], shape,
           in_world(shape, links[shape.link]), bores_of(shape.link), entry);
  }
}

}  // namespace bt
