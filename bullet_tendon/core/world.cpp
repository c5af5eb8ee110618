#include "world.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "constants.h"

namespace bt {

int World::add_chain(std::unique_ptr<Chain> chain) {
  const int slot = static_cast<int>(std::find(chains.begin(), chains.end(), nullptr) - chains.begin());
  if (slot == static_cast<int>(chains.size())) chains.emplace_back();
  chains[slot] = std::move(chain);
  return slot;
}

void World::remove_chain(int slot) {
  chains[slot].reset();
  while (!chains.empty() && !chains.back()) chains.pop_back();
  rows_.clear();
  if (slot < static_cast<int>(caches_.size())) caches_[slot].clear();
  forget_memory([&](const KeyParts& k) {
    return k.chain == slot || (k.kind == ContactKind::tendon && k.other == slot);
  });
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

int World::add_shape(const Shape& shape) { return put(shapes, shape_alive, shape); }

void World::remove_shape(int slot) {
  take(shapes, shape_alive, slot);
  rows_.clear();
  for (auto& of_chain : caches_)
    if (slot < static_cast<int>(of_chain.size())) of_chain[slot] = NearCache{};
  forget_memory([&](const KeyParts& k) { return k.kind == ContactKind::bone && k.other == slot; });
}

int World::add_tunnel(const Tunnel& tunnel) {
  const int slot = put(tunnels, tunnel_alive, tunnel);
  forget_planes();
  return slot;
}

void World::remove_tunnel(int slot) {
  take(tunnels, tunnel_alive, slot);
  rows_.clear();
  forget_planes();
  for (auto& c : chains)
    if (c) std::replace(c->tunnel_of.begin(), c->tunnel_of.end(), slot, -1);
  forget_memory([&](const KeyParts& k) {
    return (k.kind == ContactKind::bore && k.other == slot) ||
           (k.kind == ContactKind::mouth && k.other / 2 == slot);
  });
}

template <class Which>
void World::forget_memory(Which which) {
  auto gone = [&](const ContactMemory& m) { return which(parts_of(m.key)); };
  memory_.erase(std::remove_if(memory_.begin(), memory_.end(), gone), memory_.end());
}

// What was bone may be bore now, and the other way round.
void World::forget_planes() {
  for (auto& chain_caches : caches_)
    for (auto& cache : chain_caches) cache.entries.clear();
}

void World::forget_contacts() {
  memory_.clear();
  rows_.clear();
  forget_planes();
  for (auto& c : chains)
    if (c) std::fill(c->tunnel_of.begin(), c->tunnel_of.end(), -1);
}

// An attachment's point goes where the link takes it but for the tendons' forces, and yields to
// them as the link does: with W its mobility, a force F moves it by dt^2 W F within the step. Those
// that touch one link share its response, which is the stable side of counting it once.
void World::aim_attachments(Chain& c) {
  for (Hold& h : c.holds) {
    if (h.link < 0) continue;
    const Link& link = links[h.link];
    const Vec3 p = to_world(link.pose, h.local);
    h.goal = p + link.drift(p, context_.dt);
    // Explicit steps cannot take a stiff spring: there the particle goes with the link as it is.
    h.rigid = !link.yields || options.integrator == Integrator::explicit_euler;
    if (h.rigid) continue;
    Sym3 w = (context_.dt * context_.dt * std::max(1, link.touches)) * link.mobility(p);
    double least = 1e-6 * (w.xx + w.yy + w.zz) + 1e-300;  // a joint yields in some directions only
    h.stiffness = inverse(w + identity(least));
  }
}

void World::begin(double dt, Vec3 gravity) {
  roll_back();
  keep();
  context_.dt = dt, context_.gravity = gravity, context_.options = options;
  slots_.clear();
  for (Link& l : links) l.force = l.torque = Vec3{}, l.touches = l.touching, l.touching = 0;
  for (auto& c : chains) {
    slots_.push_back(c.get());
    if (!c) continue;
    for (const Hold& h : c->holds)
      if (h.link >= 0) ++links[h.link].touching;
  }
  for (Link& l : links) l.touches = std::max(l.touches, l.touching);
  for (Chain* c : slots_)
    if (c) aim_attachments(*c), begin_step(*c, context_);
  report_ = Report{};
  find_bores();
}

// A cache for every tendon and shape that are there, of planes not known yet.
void World::size_caches() {
  caches_.resize(chains.size());
  for (size_t c = 0; c < chains.size(); ++c) {
    caches_[c].resize(chains[c] ? shapes.size() : 0);
    for (size_t s = 0; s < caches_[c].size(); ++s) {
      const bool used = shape_alive[s] && !shapes[s].half_space;
      const size_t n = used ? chains[c]->n() : 0, features = used ? 2 * n - 1 : 0;
      if (caches_[c][s].entries.size() == features) continue;
      caches_[c][s].entries.assign(features, Entry{});
      caches_[c][s].local.assign(n, Vec3{});
    }
  }
}

const std::vector<Query>& World::near() {
  queries_.clear();
  size_caches();
  for (size_t c = 0; c < chains.size(); ++c) {
    if (!chains[c]) continue;
    for (size_t s = 0; s < shapes.size(); ++s) {
      if (!shape_alive[s] || shapes[s].half_space) continue;
      NearContext near{context_.dt, options.contact_threshold, options.reuse_tolerance,
                       &bores_of(shapes[s].link)};
      ask(*chains[c], static_cast<int>(c), shapes[s], static_cast<int>(s), links[shapes[s].link], near,
          caches_[c][s], queries_, report_.near);
    }
  }
  return queries_;
}

void World::answers(const double* distance, const double* points, const double* u) {
  for (size_t q = 0; q < queries_.size(); ++q) {
    const Query& query = queries_[q];
    const Shape& shape = shapes[query.shape];
    Entry& entry = caches_[query.chain][query.shape].entries[query.feature];
    kept_entries_.push_back({query.chain, query.shape, query.feature, entry});
    answer(query, distance[q], {points[3 * q], points[3 * q + 1], points[3 * q + 2]}, u[q],
           in_world(shape, links[shape.link]), bores_of(shape.link), entry);
  }
}

// Tendons that a row joins are solved together (union-find over the rows).
void World::make_groups() {
  const int count = static_cast<int>(slots_.size());
  group_of_.resize(count);
  std::iota(group_of_.begin(), group_of_.end(), 0);
  auto root = [&](int c) {
    while (group_of_[c] != c) c = group_of_[c] = group_of_[group_of_[c]];
    return c;
  };
  for (const Row& row : rows_)
    if (row.b.chain >= 0)
      group_of_[root(std::max(row.a.chain, row.b.chain))] = root(std::min(row.a.chain, row.b.chain));
  groups_.resize(count);
  for (int c = 0; c < count; ++c) {
    Group& g = groups_[c];
    g.chains.clear(), g.rows.clear(), g.extra.clear();
    g.extra.reserve(kMostExtraRows);
    g.slots = &slots_, g.coupled = false, g.finite = true, g.converged = true, g.iterations = 0,
    g.residual = 0, g.substeps = 1;
    g.linear_tolerance = 0;
  }
  for (int c = 0; c < count; ++c)
    if (slots_[c]) groups_[root(c)].chains.push_back(slots_[c]);
  for (Row& row : rows_) {
    Group& g = groups_[root(row.a.chain)];
    g.rows.push_back(&row);
    g.coupled |= row.b.chain >= 0;
  }
}

bool World::solve() {
  collect_rows();
  make_groups();
  bool finite = true;
  for (size_t s = 0; s < groups_.size(); ++s) {
    Group& g = groups_[s];
    if (g.chains.empty()) continue;
    bt::solve(g, context_);
    found_.insert(found_.end(), g.extra.begin(), g.extra.end());
    if (!g.finite) g.residual = std::numeric_limits<double>::infinity();
    finite &= g.finite;
    ++report_.groups;
    report_.iterations = std::max(report_.iterations, g.iterations);
    report_.substeps = std::max(report_.substeps, g.substeps);
    report_.converged &= g.converged;
    if (!(g.residual <= report_.residual) || report_.worst_chain < 0) {
      report_.residual = g.residual;
      const Chain* worst = g.chains[0];
      for (const Chain* c : g.chains)
        if (!(c->residual_norm <= worst->residual_norm)) worst = c;
      for (size_t c = 0; c < slots_.size(); ++c)
        if (slots_[c] == worst) report_.worst_chain = static_cast<int>(c);
      report_.worst_particle = worst->worst_particle;
    }
  }
  rows_.insert(rows_.end(), found_.begin(), found_.end());
  found_.clear();
  report_.rows = static_cast<long>(rows_.size());
  if (!finite) roll_back();
  return finite;
}

void World::finish() {
  for (Row& row : rows_) {
    if (row.link < 0) continue;
    Link& link = links[row.link];
    ++link.touching;
    // On the centreline's point, not on the surface: particles do not spin.
    link.apply(-row.mean_force, row.a.of(slots_[row.a.chain]->next));
  }
  for (Chain* c : slots_)
    for (size_t i = 0; c && i < c->holds.size(); ++i) {
      const Hold& h = c->holds[i];
      if (h.link >= 0) links[h.link].apply(h.mean_force, to_world(links[h.link].pose, h.local));
    }
  remember();
  for (Chain* c : slots_)
    if (c) finish_step(*c, context_);
  kept_moving_.clear();
}

std::vector<ContactRecord> World::contacts() const {
  std::vector<ContactRecord> out;
  for (const Row& row : rows_) {
    const Chain& c = *chains[row.a.chain];
    ContactRecord r;
    r.chain = row.a.chain, r.segment = row.a.first, r.other_chain = row.b.chain, r.link = row.link,
    r.kind = row.kind;
    r.position = row.a.of(c.x), r.normal = row.normal;
    r.distance = row.gap + row.beyond;
    r.normal_force = row.normal_force, r.friction_force = norm(row.tangent_force);
    out.push_back(r);
  }
  return out;
}

}  // namespace bt
