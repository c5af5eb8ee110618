// Rows of bones, planes and tendon pairs, and what contacts remember between steps.
#include <algorithm>
#include <chrono>
#include <cmath>

#include "constants.h"
#include "world.h"

namespace bt {

namespace {

// A particle: across the tendon its inertia and the tension on both sides; and (along) what its springs have
// at least at the reference strain besides.
HeldBack held_at(const Chain& c, int i, bool along, double gravity) {
  HeldBack held;
  held.inertia = held.stiffness = c.mass[i] / (c.b * c.b);
  double tension = 0;
  for (int k : {i - 1, i}) {
    if (k < 0 || k >= c.n() - 1) continue;
    tension = std::max(tension, c.structure.carried[k]);
    held.stiffness += std::max(0.0, c.structure.carried[k]) / c.rest[k];
    if (!along) continue;
    double force, slope;
    elastic_any(c.material.law, std::min(kReferenceStrain, c.material.law.toe_strain), force, slope);
    held.stiffness += std::max(c.structure.slope[k], c.material.stiffness * c.scale[k] * slope / c.rest[k]);
  }
  if (gravity > 0) held.hung = tension / gravity / (c.b * c.b);
  return held;
}

// A point of a segment: its ends by their weights, so that nothing jumps where the point moves along.
HeldBack held_at(const Chain& c, const Spot& s, bool along, double gravity) {
  const HeldBack one = held_at(c, s.first, along, gravity), other = held_at(c, s.first + 1, along, gravity);
  return {s.w0 * one.stiffness + s.w1 * other.stiffness, s.w0 * one.inertia + s.w1 * other.inertia,
          s.w0 * one.hung + s.w1 * other.hung};
}

// Two points that push each other apart: equal forces move both, by the sum of what they yield, so that the
// softer one decides. The harmonic mean is that, as stiff as each of them where they are alike, and the same
// whichever is named first.
double mean_of(double one, double other) { return one + other > 0 ? 2 * one * other / (one + other) : 0; }

HeldBack mean_of(const HeldBack& a, const HeldBack& b) {
  return {mean_of(a.stiffness, b.stiffness), mean_of(a.inertia, b.inertia), mean_of(a.hung, b.hung)};
}

// Whether a shape comes nearer to the inside of segment k than to its ends, which have rows of their own.
bool bulges(const NearCache& cache, int n, int k, double radius) {
  const Plane& e = cache.entries[n + k].now;
  if (e.u <= 1e-6 || e.u >= 1 - 1e-6) return false;
  auto height = [](const Plane& at, Vec3 x) { return dot(at.normal, x - at.point); };
  const Vec3 a = cache.local[k], b = cache.local[k + 1];
  const double inside = height(e, (1 - e.u) * a + e.u * b) + kNoBulge * radius;
  for (int i : {k, k + 1}) {
    const Entry& end = cache.entries[i];
    if (end.wanted && height(end.now, cache.local[i]) <= inside) return false;
  }
  return true;
}

Rot3 turn_of(const Link* link) { return link ? link->pose.rotation : Rot3{}; }

}  // namespace

void World::collect_rows() {
  rows_.clear();
  room_ = 1;
  for (size_t c = 0; c < slots_.size(); ++c) {
    if (!slots_[c]) continue;
    find_near_tunnels(*slots_[c]);
    for (const int t : near_tunnels_) {
      bore_rows(static_cast<int>(c), t);
      mouth_rows(static_cast<int>(c), t);
    }
    for (size_t s = 0; s < shapes.size(); ++s)
      if (shape_alive[s] && shapes[s].half_space) half_space_rows(static_cast<int>(c), static_cast<int>(s));
  }
  for (size_t c = 0; c < slots_.size(); ++c)
    for (size_t s = 0; slots_[c] && s < shapes.size(); ++s)
      if (shape_alive[s] && !shapes[s].half_space)
        room_ = std::min(room_, room_of(caches_[c][s], slots_[c]->radius));
  bone_rows();
  tendon_rows();
}

bool World::can_carry() const { return carries(options); }

// A plane fixed to a link, where it will be at the end of the step but for the tendons' forces.
Row World::plane_row(ContactKind kind, Spot spot, int link_slot, Vec3 point, Vec3 normal,
                     const ContactKey& key, double friction) {
  const Link& link = links[link_slot];
  const Chain& c = *slots_[spot.chain];
  const double dt = context_.dt;
  Row row;
  row.key = key, row.kind = kind, row.a = spot, row.link = link_slot;
  row.normal = unit_or(normal + dt * cross(link.spin, normal), normal);
  row.offset = dot(row.normal, point + link.drift(point, dt)) + c.radius + options.contact_threshold;
  row.beyond = options.contact_threshold;
  row.friction = friction * c.friction;
  row.reference = spot.of(c.x) + link.drift(point, dt);
  finish_row(row, spot.chain, spot.w0 >= 0.5 ? spot.first : spot.first + 1);
  return row;
}

// Gap, negative where there is depth now, that the part of the step has to leave: it takes its share of
// what the step is to push out, which is at most `most` [m].
double World::depth_to_leave(const Row& row, double most) const {
  Row now = row;
  now.evaluate(row.reference, true);
  const double depth = std::max(0.0, -now.gap), share = substeps_.share_left();
  const double left = most * (1 - substeps_.share_before());  // by the rest of the step
  return -(depth - share * std::min(depth, left));
}

// A link that contacts push at: they go with its body's unknowns. Where those are not solved for (explicit
// steps), all that touch it are taken to push alike.
void World::soften(Row& row, const Link& link, Vec3 at) const {
  row.arm = at - link.centre;
  if (options.integrator != Integrator::explicit_euler) return;
  const double w = dot(row.normal, link.mobility(at) * row.normal) * std::max(1, link.touches);
  const double yield = w * context_.dt * context_.dt;  // [m/N]
  row.stiffness /= 1 + row.stiffness * yield;
  row.grip /= 1 + row.grip * yield;
}

// Stiffness and memory.
void World::finish_row(Row& row, int chain_slot, int particle) {
  const Chain& c = *slots_[chain_slot];
  row.radius = c.radius;
  finish_row(row, held_at(c, particle, !can_carry(), norm(context_.gravity)), c.radius, c.b < context_.dt);
}

void World::finish_pair(Row& row) {
  const Chain &a = *slots_[row.a.chain], &b = *slots_[row.b.chain];
  const bool along = !can_carry();
  const double gravity = norm(context_.gravity);
  row.radius = a.radius + b.radius;
  finish_row(row, mean_of(held_at(a, row.a, along, gravity), held_at(b, row.b, along, gravity)),
             std::min(a.radius, b.radius), std::min(a.b, b.b) < context_.dt);
}

void World::finish_row(Row& row, const HeldBack& held, double radius, bool two_step) {
  const bool carries = can_carry(), chosen = options.contact_stiffness > 0;
  if (chosen)
    row.stiffness = options.contact_stiffness;
  else if (!carries)  // without multipliers, contacts have to be stiff by themselves
    row.stiffness = kSpringRatio * held.stiffness;
  else if (two_step)
    row.stiffness = std::max(kTwoStepContactRatio * held.stiffness, kTwoStepHungRatio * held.hung);
  else
    row.stiffness = std::max(kContactRatio * held.stiffness, kHungRatio * held.hung);
  // A particle that lies loose is gripped before it gathers speed.
  row.grip = carries ? kGripRatio * held.stiffness + kLooseGripRatio * held.inertia
                     : kSpringGripRatio * held.stiffness;
  if (row.link >= 0 && links[row.link].yields())
    soften(row, links[row.link], row.a.of(slots_[row.a.chain]->x));
  row.softest = carries && !chosen ? row.stiffness : 0;
  row.allowed = depth_to_leave(row, kPushOut * radius);
  recall(row, held.inertia);
}

void World::add_row(const Row& row) {
  if (!overruled(row, *slots_[row.a.chain])) rows_.push_back(row);
}

void World::recall(Row& row, double inertia) {
  auto found = std::lower_bound(memory_.begin(), memory_.end(), row.key,
                                [](const ContactMemory& m, const ContactKey& key) { return m.key < key; });
  if (found == memory_.end() || !(found->key == row.key)) return;
  const Rot3 turn = turn_of(row.link >= 0 ? &links[row.link] : nullptr);
  const bool carries = can_carry() && options.contact_stiffness == 0;  // a spring as published has no memory
  row.stuck = without(turn * found->stuck, row.normal);
  // What sticks goes on with its force where its stiffness changes with the step's weight.
  if (carries && found->b != slots_[row.a.chain]->b) {
    const double per_inertia = kGripRatio + kLooseGripRatio;
    const double more = inertia * (std::pow(slots_[row.a.chain]->b / found->b, 2) - 1);
    row.stuck = (1 + per_inertia * more / row.grip) * row.stuck;
  }
  row.before = found->carried;
  row.carried = !carries ? 0 : whole_ ? found->carried : found->confirmed;
  row.multiplier = row.before;
  row.last_mean = found->mean_force;
  row.limit = row.friction * row.before;
  row.sliding = found->sliding;
}

void World::remember() {
  auto awake = [&](const ContactMemory& m) { return chains[m.key.tendon]->bed < 0; };
  memory_.erase(std::remove_if(memory_.begin(), memory_.end(), awake), memory_.end());
  touching_.assign(slots_.size(), 0);
  for (Chain* c : slots_)
    if (c) c->touched = false;
  for (const Row& row : rows_) {
    if (row.normal_force <= 0) continue;
    slots_[row.a.chain]->touched = true;
    if (row.b.chain >= 0) slots_[row.b.chain]->touched = true;
    if (row.link >= 0) touching_[row.a.chain] += hash_of(row.key);
    const Rot3 turn = turn_of(row.link >= 0 ? &links[row.link] : nullptr);
    memory_.push_back({row.key, row.normal_force, std::min(row.normal_force, row.before), row.sliding,
                       row.mean_force, slots_[row.a.chain]->b, transposed_times(turn, row.displacement)});
  }
  std::sort(memory_.begin(), memory_.end(),
            [](const ContactMemory& a, const ContactMemory& b) { return a.key < b.key; });
  for (size_t c = 0; c < slots_.size(); ++c)
    if (slots_[c]) {
      slots_[c]->smooth = slots_[c]->touching == touching_[c];
      slots_[c]->touching = touching_[c];
    }
}

void World::bone_rows() {
  for (size_t c = 0; c < slots_.size(); ++c) {
    if (!slots_[c]) continue;
    const int n = slots_[c]->n(), chain = static_cast<int>(c);
    for (size_t s = 0; s < shapes.size(); ++s) {
      if (!shape_alive[s] || shapes[s].half_space) continue;
      const Shape& shape = shapes[s];
      const Pose pose = in_world(shape, links[shape.link]);
      std::vector<Entry>& entries = caches_[c][s].entries;
      for (int f = 0; f < static_cast<int>(entries.size()); ++f) {
        const Entry& e = entries[f];
        if (!e.wanted) continue;
        const bool segment = f >= n;
        if (segment && !bulges(caches_[c][s], n, f - n, slots_[c]->radius)) continue;
        const int first = segment ? f - n : std::min(f, n - 2);
        Spot spot{chain, first,
                  segment      ? 1 - e.now.u
                  : f == first ? 1.0
                               : 0.0,
                  segment      ? e.now.u
                  : f == first ? 0.0
                               : 1.0};
        const Vec3 here = spot.of(slots_[c]->x), ahead = spot.of(slots_[c]->foreseen);
        Vec3 point = e.now.point, normal = e.now.normal;
        lean_ahead(caches_[c][s], f, to_local(pose, ahead - links[shape.link].drift(here, context_.dt)),
                   point, normal);
        point = to_world(pose, point), normal = pose.rotation * normal;
        const ContactKey key{0, ContactKind::bone, chain, f, static_cast<int>(s)};
        Row row = plane_row(ContactKind::bone, spot, shape.link, point, normal, key, shape.friction);
        row.direct =
            !segment && options.bone_contact == BoneContact::constraint && !links[shape.link].yields();
        add_row(row);
      }
    }
  }
}

void World::half_space_rows(int chain, int s) {
  const Chain& c = *slots_[chain];
  const Shape& shape = shapes[s];
  const Link& link = links[shape.link];
  const Pose pose = in_world(shape, link);
  const Vec3 normal = pose.rotation * shape.plane_normal;
  const double offset = shape.plane_offset + dot(normal, pose.origin);
  for (int i = 0; i < c.n(); ++i) {
    Vec3 x = c.x.at(i);
    double height = dot(normal, x) - offset;
    if (height > reach_of(c, i, link, context_.dt, options.contact_threshold)) continue;
    const int first = std::min(i, c.n() - 2);
    Spot spot{chain, first, i == first ? 1.0 : 0.0, i == first ? 0.0 : 1.0};
    Row row = plane_row(ContactKind::bone, spot, shape.link, x - height * normal, normal,
                        {0, ContactKind::bone, chain, i, s}, shape.friction);
    row.direct = options.bone_contact == BoneContact::constraint && !link.yields();
    add_row(row);
  }
}

// Algorithm 1, steps 3 and 4.
void World::tendon_rows() {
  const auto start = std::chrono::steady_clock::now();
  pairs_.clear();
  const Foresight foresight = substeps_.divisible() ? Foresight::swept : Foresight::near;
  report_.pairs = broad_phase_.find(slots_, options.contact_threshold, foresight, pairs_);
  report_.search_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  room_ = std::min(room_, report_.pairs.room);
  for (const SegmentPair& p : pairs_) {
    const Chain &a = *slots_[p.chain_a], &b = *slots_[p.chain_b];
    Row row;
    row.kind = ContactKind::tendon;
    row.key = {0, row.kind, p.chain_a, p.segment_a, p.chain_b, p.segment_b};
    row.a = {p.chain_a, p.segment_a, 1 - p.u, p.u};
    row.b = {p.chain_b, p.segment_b, 1 - p.w, p.w};
    Vec3 along = a.x.at(p.segment_a + 1) - a.x.at(p.segment_a);
    row.normal = p.distance > 1e-9 * a.radius ? (1 / p.distance) * p.apart
                                              : any_perpendicular(unit_or(along, {1, 0, 0}));
    const double radii = a.radius + b.radius, apart = kept_apart(p, a, b, links);
    if (apart < kNearlyMet * radii) continue;
    row.offset = apart + options.contact_threshold;
    row.beyond = row.offset - radii;
    row.friction = a.friction * b.friction;
    row.reference = p.apart, row.side = row.normal, row.stuck_at = p.u, row.stuck_at_other = p.w;
    row.passes = p.passes;
    finish_pair(row);
    add_row(row);
  }
}

}  // namespace bt
