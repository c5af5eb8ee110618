// Captures and restores checkpoints, and converts them to bytes.
#include "world/checkpoint.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "world/archive.h"
#include "world/state_fields.h"
#include "world/world.h"

namespace bt {

// Calls copy(present, saved) for every part of a world's state and its place in a checkpoint.
template <class W, class C, class Copy>
void World::each_part(W& world, C& checkpoint, Copy copy) {
  for (auto [slot, tendon] : filled(world.scene.tendons)) {
    auto& saved = checkpoint.tendons[slot];
    copy(static_cast<TendonState&>(tendon), saved.state);
    copy(static_cast<SpringState&>(tendon.structure), saved.structure);
    copy(static_cast<SpringState&>(tendon.shear), saved.shear);
  }
  for (auto [slot, ligament] : filled(world.scene.ligaments))
    copy(static_cast<LigamentState&>(ligament), checkpoint.elements.ligaments[slot]);
  for (auto [slot, cartilage] : filled(world.scene.cartilages))
    copy(static_cast<CartilageState&>(cartilage), checkpoint.elements.cartilages[slot]);
  copy(world.scene.links, checkpoint.links);
  copy(world.scene.bodies, checkpoint.bodies);
  copy(world.touching, checkpoint.touching);
  copy(world.touching_known, checkpoint.touching_known);
  copy(world.contacts_.memory, checkpoint.memory);
  copy(world.contacts_.all, checkpoint.contacts);
  copy(world.contacts_.asleep, checkpoint.sleeping_contacts);
  copy(world.sleep_.gravity, checkpoint.rest_gravity);
  copy(world.stiffness.held, checkpoint.held);
  copy(world.history_.last_step, checkpoint.last_step);
  copy(world.history_.may_resolve, checkpoint.may_resolve);
}

void World::capture(Checkpoint& to) const {
  to.valid = true;
  to.tendons.resize(scene.tendons.size());
  for (size_t c = 0; c < scene.tendons.size(); ++c) to.tendons[c].alive = scene.tendons[c] != nullptr;
  to.elements.ligaments.resize(scene.ligaments.size());
  to.elements.cartilages.resize(scene.cartilages.size());
  each_part(*this, to, [](const auto& present, auto& saved) { saved = present; });
}

void World::apply(const Checkpoint& from) {
  const int count = static_cast<int>(scene.links.size());
  each_part(*this, from, [](auto& present, const auto& saved) { present = saved; });
  for (auto [slot, c] : filled(scene.tendons))
    if (c.material.tissue.can_rupture()) c.share_out();
  ensure_link(count - 1);          // shapes or tunnels added since then refer to links
  detection_.broad_phase.clear();  // its results do not depend on its cache
}

std::shared_ptr<Checkpoint> World::checkpoint() const {
  auto found = std::make_shared<Checkpoint>();
  capture(*found);
  return found;
}

void World::return_to(const Checkpoint& at) {
  apply(at);
  history_.may_resolve = false;
}

bool World::attempt(double dt, Vec3 gravity, bool whole, DistanceOracle& oracle,
                    const std::function<void()>& sense) {
  using Clock = std::chrono::steady_clock;
  capture(*history_.now);
  start_budget(oracle);
  step_.attempted = true;
  Clock::duration sensed{};
  bool solved = false, stepping = false;
  // Once the step begins, history_.start is the checkpoint before it.
  auto undo = [&] {
    step_.attempted = false;
    if (stepping) history_.now.swap(history_.start);
    apply(*history_.now);
  };
  try {
    if (sense) {
      const auto begun = Clock::now();
      sense();
      sensed = Clock::now() - begun;
    }
    history_.now.swap(history_.start);
    stepping = true;
    solved = step(dt, gravity, whole, oracle);
  } catch (...) {
    undo();
    throw;
  }
  if (!solved) undo();
  step_.attempted = false;
  step_.report.sense_seconds = std::chrono::duration<double>(sensed).count();
  return solved;
}

bool World::hold(double dt, Vec3 gravity, double at_hand, DistanceOracle& oracle) {
  step_.at_hand = at_hand;
  return attempt(dt, gravity, true, oracle, [&] { sense(dt, gravity, true); });
}

namespace {

void require(bool valid, const char* what) {
  if (!valid) throw StateMismatch(what);
}

constexpr const char* kSizes = "with as many numbers as the world's parts have";
constexpr const char* kIndices = "with indices of the world's parts";

bool within(int index, size_t count) { return index >= 0 && static_cast<size_t>(index) < count; }

template <class T>
bool filled_at(const Slots<T>& slots, int slot) {
  return within(slot, slots.size()) && slots[slot];
}

void require_springs(const SpringState& s, size_t count, const Tissue& tissue) {
  for (const auto* list : {&s.lambda, &s.elastic, &s.slope}) require(list->size() == count, kSizes);
  require(s.unrelaxed.size() == (tissue.relaxes() ? count : 0), kSizes);
  require(s.memory.size() == count * tissue.weights.size(), kSizes);
}

void require_model(const TendonModel& m, size_t n) {
  require(static_cast<size_t>(m.force.size()) == n, kSizes);
  require(m.point_mass.size() == n && m.rest.size() == n - 1, kSizes);
  for (double length : m.rest) require(length > 0, "with rest lengths above 0");
  for (double mass : m.point_mass) require(mass >= 0, "with masses of at least 0");
}

void require_tendon(const TendonCheckpoint& t, const Tendon& c, size_t links, const Slots<Tunnel>& tunnels) {
  const TendonState& s = t.state;
  const size_t n = c.n();
  for (const Field* f : {&s.x, &s.v, &s.x_before, &s.v_before})
    require(static_cast<size_t>(f->size()) == n, kSizes);
  require(!s.with_body || static_cast<size_t>(s.mean_velocities.size()) == n, kSizes);
  require(s.tunnel_of.size() == n, kSizes);
  require_springs(t.structure, c.structure.count, c.material.tissue);
  require_springs(t.shear, c.shear.count, c.material.tissue);
  for (int segment : s.torn) require(within(segment, n - 1), kIndices);
  for (int in : s.tunnel_of) require(in == -1 || filled_at(tunnels, in), kIndices);
  for (const Threaded& of : s.threaded)
    require(within(of.segment, n - 1) && filled_at(tunnels, of.tunnel), kIndices);
  for (const Anchor& h : s.anchors) {
    require(within(h.particle, n), kIndices);
    require(h.link == -1 || within(h.link, links), kIndices);
    require(!h.is_line || (h.link >= 0 && !h.rigid && h.line.spring >= 0), "with lines to links");
  }
  for (uint64_t pair : s.overlaid) {
    const uint64_t k = pair >> 32, m = pair & 0xffffffffu;
    require(k < m && m < n - 1, kIndices);
  }
  require(std::is_sorted(s.overlaid.begin(), s.overlaid.end()), "in order");
}

// Pairs of links that touch are counted in an int.
constexpr double kMostPairs = 1 << 30;

// Arrays of a body with n coordinates have n, n^2 or 3 n numbers, or none.
bool fits(const dense::Numbers& list, size_t n) {
  const size_t size = list.size();
  return size == 0 || size == n || size == n * n || size == 3 * n;
}

struct SizesOfBody {
  size_t n;
  bool fit = true;
  size_t stops = 0;
  template <class T>
  void operator()(const char* name, T& value) {
    if constexpr (std::is_same_v<T, dense::Numbers>) {
      const std::string field = name;
      const size_t size = value.size();
      if (field == "limits")
        fit &= size % 3 == 0;
      else if (field == "shifts")
        fit &= size % 2 == 0;
      else if (field == "contacts")
        fit &= size % (n + 2) == 0;
      else if (field == "frictions")
        fit &= size % (n + 3) == 0;
      else if (field == "directions_")
        fit &= size == stops * n;
      else if (field == "external" || field == "motors.reported" || field == "motors.reported_before" ||
               field == "motors.off" || field == "forces")
        fit &= size == 0 || size == n;
      else if (field != "pushes_" && field != "doubted_")
        fit &= fits(value, n);
    } else if constexpr (std::is_same_v<T, std::vector<Stop>>) {
      stops = value.size();
      for (const Stop& stop : value)
        fit &= (!stop.motor && stop.coordinate == -1) || within(stop.coordinate, n);
    } else if constexpr (std::is_same_v<T, int>) {
      fit &= std::string(name) != "n_" || value == 0 || (value > 0 && static_cast<size_t>(value) == n);
    } else if constexpr (std::is_same_v<T, std::vector<JointMotor>>) {
      fit &= value.empty() || value.size() == n;
    } else if constexpr (!kPlain<T>) {
      visit(*this, value);
    }
  }
};

void require_body(const GeneralizedBody& body) {
  SizesOfBody sizes{body.rates.size()};
  visit(sizes, const_cast<GeneralizedBody&>(body));
  for (size_t k = 0; k + 2 < body.stops.limits.size(); k += 3)
    sizes.fit &= body.stops.limits[k] >= 0 && body.stops.limits[k] < body.rates.size();
  for (size_t k = 0; k + 1 < body.stops.shifts.size(); k += 2)
    sizes.fit &= body.stops.shifts[k] >= 0 && body.stops.shifts[k] < body.rates.size();
  // The last number of a row is the pair of links that touch.
  auto check_pairs = [&](const dense::Numbers& rows, size_t row) {
    for (size_t k = row - 1; k < rows.size(); k += row) sizes.fit &= rows[k] >= 0 && rows[k] < kMostPairs;
  };
  check_pairs(body.stops.contacts, body.rates.size() + 2);
  check_pairs(body.stops.frictions, body.rates.size() + 3);
  const BodyHistory& history = body.history;
  sizes.fit &= history.known.empty() || history.known.size() == body.rates.size();
  require(sizes.fit, kSizes);
}

void require_link(const Link& l, const std::vector<GeneralizedBody>& bodies) {
  require(l.body == -1 || within(l.body, bodies.size()), kIndices);
  const size_t n = l.body < 0 ? 0 : bodies[l.body].rates.size();
  for (const auto* list : {&l.jacobian, &l.root})
    require(list->empty() || l.body < 0 || list->size() == 6 * n, kSizes);
}

}  // namespace

// Throws StateMismatch unless all sizes and indices fit this world.
void World::require_state(const Checkpoint& c) const {
  require(c.tendons.size() == scene.tendons.size(), kSizes);
  require(c.last_step.dt >= 0, "with a last step of a length of at least 0");
  for (size_t t = 0; t < scene.tendons.size(); ++t)
    require(c.tendons[t].alive == (scene.tendons[t] != nullptr), "of a world that is made of the same parts");
  for (auto [slot, tendon] : filled(scene.tendons))
    require_tendon(c.tendons[slot], tendon, std::max(scene.links.size(), c.links.size()), scene.tunnels);
  for (const GeneralizedBody& body : c.bodies) require_body(body);
  for (const GeneralizedBody& body : c.sensed_bodies) require_body(body);
  require(c.bodies.size() == c.links.size() || c.bodies.empty(), kSizes);
  require(c.sensed_bodies.size() == c.sensed_links.size() || c.sensed_bodies.empty(), kSizes);
  for (const Link& l : c.links) require_link(l, c.bodies);
  for (const Link& l : c.sensed_links) require_link(l, c.sensed_bodies);
  auto segment = [&](int tendon, int first) {
    return filled_at(scene.tendons, tendon) && within(first, scene.tendons[tendon]->n() - 1);
  };
  auto of_parts = [&](const ContactKey& k) {
    if (!filled_at(scene.tendons, k.tendon) || !within(k.feature, 2 * scene.tendons[k.tendon]->n() - 1))
      return false;
    switch (k.kind) {
      case ContactKind::bone:
        return filled_at(scene.shapes, k.other);
      case ContactKind::bore:
        return filled_at(scene.tunnels, k.other);
      case ContactKind::mouth:
        return k.other >= 0 && filled_at(scene.tunnels, k.other / 2);
      case ContactKind::tendon:
        return segment(k.other, k.other_feature);
    }
    return false;
  };
  auto require_contact = [&](const Contact& r) {
    require(segment(r.a.tendon, r.a.first) && (r.b.tendon == -1 || segment(r.b.tendon, r.b.first)), kIndices);
    require(r.link == -1 || within(r.link, c.links.size()), kIndices);
    require(of_parts(r.key), kIndices);
  };
  for (const Contact& r : c.contacts) require_contact(r);
  for (const Contact& r : c.sleeping_contacts) require_contact(r);
  for (const ContactMemory& m : c.memory) require(of_parts(m.key), kIndices);
  auto in_order = [](const ContactMemory& a, const ContactMemory& b) { return a.key < b.key; };
  require(std::is_sorted(c.memory.begin(), c.memory.end(), in_order), "in order");
}

// Throws StateMismatch unless the elements are those of this world.
void World::require_elements(const ElementCheckpoint& c) const {
  require(c.ligaments.size() == scene.ligaments.size(), kSizes);
  require(c.cartilages.size() == scene.cartilages.size(), kSizes);
  for (auto [slot, ligament] : filled(scene.ligaments))
    require(c.ligaments[slot].memory.size() == ligament.material().tissue.weights.size(), kSizes);
  for (auto [slot, cartilage] : filled(scene.cartilages))
    require(c.cartilages[slot].regions.size() == cartilage.regions.size(), kSizes);
}

// FNV-1a hash of the properties that a world must share with a state to restore it.
uint64_t World::structure_mark() const {
  std::vector<char> bytes;
  StateWriter write(bytes);
  for (const auto& c : scene.tendons) {
    write("particles", c ? c->n() : 0);
    if (!c) continue;
    write("radius", c->radius);
    write("friction", c->friction);
    write("material", c->material);
    if (c->material.law.lengthening_only) write("lengthening_only", c->material.law.lengthening_only);
  }
  auto write_all = [&write](const auto& parts, auto write_one) {
    for (const auto& part : parts) {
      write("alive", part != nullptr);
      if (part) write_one(*part);
    }
  };
  write_all(scene.shapes, [&](const Shape& shape) {
    write("shape", shape);
    write("surface", shape.surface ? shape.surface->mark() : 0);
  });
  write_all(scene.tunnels, [&](const Tunnel& tunnel) { write("tunnel", tunnel); });
  write_all(scene.ligaments, [&](const Ligament& ligament) {
    write("path", ligament.path());
    write("wraps", ligament.wraps());
    write("material", ligament.material());
    write("lengthening_only", ligament.material().law.lengthening_only);
  });
  write_all(scene.cartilages, [&](const Cartilage& cartilage) {
    write("one", cartilage.link_a());
    write("other", cartilage.link_b());
    write("model", cartilage.model());
    write("surfaces", cartilage.mark());
  });
  uint64_t hash = 14695981039346656037ull;
  for (const char byte : bytes) hash = (hash ^ static_cast<unsigned char>(byte)) * 1099511628211ull;
  return hash;
}

std::vector<char> World::save() {
  size_caches();
  empty_caches();
  std::vector<char> out;
  StateWriter write(out);
  write("structure", structure_mark());
  Checkpoint now, none;
  capture(now);
  for (auto [slot, c] : filled(scene.tendons)) write("model", static_cast<TendonModel&>(c));
  write("filter", scene.filter);
  write("now", now);
  write("start", history_.may_resolve ? *history_.start : none);
  for (auto& of_tendon : detection_.caches)
    for (NearCache& cache : of_tendon) write("planes", cache.entries);
  if (!scene.has_elements()) return out;
  for (auto [slot, ligament] : filled(scene.ligaments))
    write("ligament", static_cast<LigamentModel&>(ligament));
  write("elements", now.elements);
  write("elements", history_.may_resolve ? history_.start->elements : none.elements);
  return out;
}

void World::restore(const char* from, size_t size) {
  size_caches();
  StateReader read(from, size);
  uint64_t mark = 0;
  read("structure", mark);
  require(mark == structure_mark(), "of a world that is made of the same parts");
  Checkpoint now, start;
  std::vector<TendonModel> models(scene.tendons.size());
  for (auto [slot, c] : filled(scene.tendons)) {
    read("model", models[slot]);
    require_model(models[slot], c.n());
  }
  CollisionFilter filter;
  read("filter", filter);
  read("now", now);
  read("start", start);
  require(now.valid, "of a world");
  std::vector<std::vector<Entry>> planes;
  for (size_t c = 0; c < detection_.caches.size(); ++c)
    for (size_t s = 0; s < detection_.caches[c].size(); ++s) {
      planes.emplace_back();
      read("planes", planes.back());
      const bool used = scene.tendons[c] && scene.shapes[s] && !scene.shapes[s]->half_space;
      require(
          planes.back().empty() || (used && planes.back().size() == 2 * size_t(scene.tendons[c]->n()) - 1),
          kSizes);
    }
  std::vector<LigamentModel> ligaments(scene.ligaments.size());
  if (scene.has_elements()) {
    for (auto [slot, ligament] : filled(scene.ligaments)) {
      read("ligament", ligaments[slot]);
      require(ligaments[slot].rest > 0, "with rest lengths above 0");
    }
    read("elements", now.elements);
    read("elements", start.elements);
    require_elements(now.elements);
    if (start.valid) require_elements(start.elements);
  }
  read.finish();
  require(filter.is_valid(scene.tendons.size(), now.links.size()), kIndices);
  require_state(now);
  if (start.valid) require_state(start);
  for (auto [slot, c] : filled(scene.tendons)) {
    c.force = models[slot].force;
    c.point_mass = models[slot].point_mass;
    c.set_rest(models[slot].rest);
  }
  for (auto [slot, ligament] : filled(scene.ligaments))
    static_cast<LigamentModel&>(ligament) = ligaments[slot];
  scene.filter = std::move(filter);
  apply(now);
  *history_.start = std::move(start);
  size_t k = 0;
  for (auto& of_tendon : detection_.caches)
    for (NearCache& cache : of_tendon) cache.entries = std::move(planes[k++]);
}

}  // namespace bt
