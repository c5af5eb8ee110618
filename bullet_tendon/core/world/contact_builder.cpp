// Rows of bones, planes and tendon pairs, and what contacts remember between steps.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <type_traits>
#include <vector>

#include "solver/assembly.h"
#include "world/world.h"

namespace bt {

namespace {

// Contact stiffness in units of what holds a particle back across its tendon: inertia and tension over
// length [-]. The contact force itself comes from carried multipliers, so this sets how fast depth
// vanishes, not how deep a resting contact is. Larger: active contacts are found in more iterations.
// Smaller: more rounds of stiffening after impacts.
constexpr double kContactRatio = 30.0;

// The same for the weights of two-step methods [-]. A force that is carried over lags behind the depth that
// it answers to, which feeds vibrations; the less so the stiffer, and two-step methods damp them hardly. At
// 30 what rests over an edge begins to vibrate; at 100 it does not.
constexpr double kTwoStepContactRatio = 300.0;

// The same in units of the inertia of what hangs from the tendon, T/g over the step's weight squared, as far
// as that is more [-]; and for two-step methods. By g = (N_0 - N)/k, N_0 the force of a step ago, the contact
// works N g' = dt N'^2/k on what vibrates, on average over a cycle: it never dies away where that is more
// than the method damps, for two-step methods at k < 4 m/dt^2, and weights creep over rough edges in steps of
// a coarse tendon. Smaller: they do. Larger: active contacts are found in more iterations.
constexpr double kHungRatio = 1.0;
constexpr double kTwoStepHungRatio = 4.0;

// Depth that a step pushes out at most, in radii [-]. Depth over the step's length is a velocity, which
// stays: larger, and a tendon that was put into a bone is shot out of it. Smaller: it takes longer.
constexpr double kPushOut = 0.5;

// Stiffness of a sticking contact, in the same units [-]. It sets how far a contact yields before it
// slides (micrometres). Larger: the corner between sticking and sliding gets so sharp that
// iterations step over it. Smaller: a sticking tendon gives visibly.
constexpr double kGripRatio = 1.0;

// What the particle's inertia adds to that, in units of the inertia [-]. What is laid on a slope gathers
// g dt before its contacts are stretched: with friction larger than its weight's pull by a share of less than
// about 1 / this, it slips first. Larger: more iterations. Smaller: tendons that should lie creep first.
constexpr double kLooseGripRatio = 300.0;

// Both for methods that carry no multipliers, in units of all the stiffness that a particle has [-].
// Larger: worse conditioned. Smaller: deeper contacts.
constexpr double kSpringRatio = 10.0;
constexpr double kSpringGripRatio = 0.1;

// What a surface is nearer to the inside of a segment than to its ends, in radii, for the segment to get
// a contact of its own [-]. Larger: rounded bones go deeper in between. Smaller: contacts on flat ones
// come three to a segment, and share the load as rounding has it.
constexpr double kNoBulge = 1e-5;

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

// Algorithm 2: which stretch of a tendon is in which tunnel, and the rows of bores and mouths.

void World::find_bores() {
  bores_.resize(tunnels.size());
  bores_by_link_.resize(links.size());
  for (auto& list : bores_by_link_) list.clear();
  for (size_t t = 0; t < tunnels.size(); ++t) {
    if (!tunnel_alive[t]) continue;
    bores_[t] = in_world(tunnels[t], links[tunnels[t].link]);
    bores_by_link_[tunnels[t].link].push_back(bores_[t]);
  }
  for (Chain* c : slots_)
    if (c && !tunnels.empty()) classify(*c);
}

// Step 1. A particle enters a bore within its radius, and then stays in it wherever it is pushed
// until it is beyond a mouth: a bore that a violent step left is not forgotten.
void World::classify(Chain& c) {
  Box box;
  for (int i = 0; i < c.n(); ++i) box.include(c.x.at(i));
  near_tunnels_.clear();
  for (size_t t = 0; t < tunnels.size(); ++t)
    if (tunnel_alive[t] && overlap(box, bores_[t].box, c.radius))
      near_tunnels_.push_back(static_cast<int>(t));
  for (int i = 0; i < c.n(); ++i) {
    int& in = c.tunnel_of[i];
    const Vec3 x = c.x.at(i);
    if (in >= 0) {
      double z = bores_[in].along(x);
      if (tunnel_alive[in] && z >= 0 && z <= bores_[in].length) continue;
      in = -1;
    }
    for (size_t k = 0; k < near_tunnels_.size() && in < 0; ++k)
      if (bores_[near_tunnels_[k]].contains(x, 0)) in = near_tunnels_[k];
  }
}

// What is outside of a bore's box by all that the tendon and the bore can do in the step, and by the longest
// segment, has no row of it (bore_rows, mouth_reach).
void World::find_near_tunnels(const Chain& c) {
  near_tunnels_.clear();
  if (tunnels.empty()) return;
  Box box;
  double moved = 0, longest = 0;
  for (int i = 0; i < c.n(); ++i) {
    box.include(c.x.at(i));
    moved = std::max(moved, norm(c.foreseen.at(i) - c.x.at(i)));
  }
  for (double l : c.rest) longest = std::max(longest, l);
  const double own = c.radius + options.contact_threshold + c.most_slack + moved + longest;
  const Vec3 middle = 0.5 * (box.lo + box.hi);
  const double half = 0.5 * norm(box.hi - box.lo);
  for (size_t t = 0; t < tunnels.size(); ++t) {
    if (!tunnel_alive[t]) continue;
    const Link& link = links[tunnels[t].link];
    // The bore's motion is linear in the place.
    const double carried = norm(link.drift(middle, context_.dt)) + context_.dt * norm(link.spin) * half;
    ++report_.near.tunnels;
    if (overlap(box, bores_[t].box, own + carried + tunnels[t].chamfer) ||
        std::find(c.tunnel_of.begin(), c.tunnel_of.end(), t) != c.tunnel_of.end())
      near_tunnels_.push_back(static_cast<int>(t));
    else
      ++report_.near.tunnels_culled;
  }
}

// Step 2: |across(axis)(x - p)| <= R - r for particles inside, or about to be.
void World::bore_rows(int chain, int t) {
  const Chain& c = *slots_[chain];
  const Bore& bore = bores_[t];
  const Link& link = links[tunnels[t].link];
  const double dt = context_.dt;
  for (int i = 0; i < c.n(); ++i) {
    const Vec3 x = c.x.at(i), ahead = c.foreseen.at(i) - link.drift(x, dt);
    const bool inside = c.tunnel_of[i] == t;
    if (!inside && !(bore.contains(ahead, 0) && bore.off_axis(x) <= bore.radius)) continue;
    const double z = std::min(std::max(bore.along(x), 0.0), bore.length);
    // Within a chamfer the wall is the mouth's own round edge.
    if (z < bore.chamfer || z > bore.length - bore.chamfer) continue;
    const Vec3 on_axis = bore.start + z * bore.axis;
    Row row;
    const int first = std::min(i, c.n() - 2);
    row.kind = ContactKind::bore, row.link = tunnels[t].link;
    row.key = {0, row.kind, chain, i, t};
    row.a = {chain, first, i == first ? 1.0 : 0.0, i == first ? 0.0 : 1.0};
    row.axis_point = on_axis + link.drift(on_axis, dt);
    row.axis = unit_or(bore.axis + dt * cross(link.spin, bore.axis), bore.axis);
    row.ring = std::max(0.0, bore.radius - c.radius - options.contact_threshold);
    row.beyond = options.contact_threshold;
    row.normal = unit_or(-without(x - on_axis, bore.axis), any_perpendicular(bore.axis));
    row.friction = tunnels[t].friction * c.friction;
    row.reference = x + link.drift(x, dt);
    finish_row(row, chain, i);
    add_row(row);
  }
}

// Step 3: the segments near a mouth's circle.
void World::mouth_rows(int chain, int t) {
  const Chain& c = *slots_[chain];
  const Bore& bore = bores_[t];
  for (int mouth : {0, 1}) {
    const double z = mouth ? bore.length - bore.chamfer : bore.chamfer, radius = bore.radius + bore.chamfer;
    const Vec3 centre = bore.start + z * bore.axis;
    for (int k = 0; k + 1 < c.n(); ++k) {
      const Vec3 a = c.x.at(k), b = c.x.at(k + 1), d = b - a;
      const double reach = mouth_reach(chain, t, k);
      const double length2 = dot(d, d);
      const double u = length2 > 0 ? std::min(1.0, std::max(0.0, dot(centre - a, d) / length2)) : 0;
      if (norm(a + u * d - centre) > radius + reach) continue;
      // Both ends deep inside: the bore's own rows hold them.
      auto inside = [&](Vec3 p, int i) {
        double s = bore.along(p);
        return c.tunnel_of[i] == t && s >= bore.chamfer && s <= bore.length - bore.chamfer;
      };
      if (inside(a, k) && inside(b, k + 1)) continue;
      mouth_row(chain, t, mouth, k, bore, centre, radius);
    }
  }
}

// How far segment k can come towards an edge of the tunnel's mouths within the step [m].
double World::mouth_reach(int chain, int t, int k) const {
  const Link& link = links[tunnels[t].link];
  auto reach = [&](int i) {
    return reach_of(*slots_[chain], i, link, context_.dt, options.contact_threshold);
  };
  // A segment longer: the edge is sharp, and what lies beside it can be over it in a step.
  return std::max(reach(k), reach(k + 1)) + slots_[chain]->rest[k] + tunnels[t].chamfer;
}

void World::mouth_row(int chain, int t, int mouth, int k, const Bore& bore, Vec3 centre, double radius) {
  const Chain& c = *slots_[chain];
  const Link& link = links[tunnels[t].link];
  const double dt = context_.dt;
  const Vec3 a = c.x.at(k), b = c.x.at(k + 1);
  // The point that is nearest at the end of the step: another one would have slid past the edge by then,
  // which would push it on.
  const double u = nearest_to_circle(c.foreseen.at(k) - link.drift(a, dt),
                                     c.foreseen.at(k + 1) - link.drift(b, dt), centre, bore.axis, radius);
  if (u >= 1 && k + 2 < c.n()) return;  // the next segment starts there
  const Vec3 x = (1 - u) * a + u * b;
  const Vec3 sideways = unit_or(without(x - centre, bore.axis), any_perpendicular(bore.axis));
  const Vec3 edge = nearest_on_circle(x, centre, bore.axis, radius, sideways);
  const Vec3 apart = x - edge;
  const double distance = norm(apart);
  if (distance > mouth_reach(chain, t, k)) return;
  const double motion = std::max(motion_of(c, k, link, dt), motion_of(c, k + 1, link, dt));
  room_ = std::min(room_, share_to_go(distance, c.radius + bore.chamfer, motion));
  const double za = dot(a - centre, bore.axis), zb = dot(b - centre, bore.axis);
  Row row;
  row.kind = ContactKind::mouth, row.link = tunnels[t].link;
  row.key = {0, row.kind, chain, k, 2 * t + mouth};
  row.a = {chain, k, 1 - u, u}, row.stuck_at = u;
  row.axis_point = centre + link.drift(centre, dt);
  row.axis = unit_or(bore.axis + dt * cross(link.spin, bore.axis), bore.axis);
  row.ring = radius, row.beyond = options.contact_threshold;
  row.offset = c.radius + bore.chamfer + options.contact_threshold;
  row.through = (c.tunnel_of[k] == t || c.tunnel_of[k + 1] == t) && za * zb < 0;
  row.normal = unit_or(apart, -sideways);
  row.friction = tunnels[t].friction * c.friction;
  row.reference = x + link.drift(x, dt);
  finish_row(row, chain, u < 0.5 ? k : k + 1);
  add_row(row);
}

}  // namespace bt
