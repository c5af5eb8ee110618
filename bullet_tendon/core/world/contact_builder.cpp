// Makes the contacts of a substep: their stiffness, warm start and memory, whatever the kind. Those of bones
// and tunnels are found in bone_contacts.cpp and tunnel_contacts.cpp.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>
#include <vector>

#include "solver/assembly.h"
#include "world/world.h"

namespace bt {

namespace {

// Contact stiffness over the transverse stiffness of a particle (inertia over the squared step weight, and
// tension over segment length) [-]. The multipliers carry the load, so that this ratio sets how fast depth
// vanishes, and not the depth of a resting contact. Larger: the active set takes more iterations. Smaller:
// impacts and heavy loads need more augmented Lagrangian updates. With 100, rounding a kilometre from the
// origin decides about what slides.
constexpr double kContactRatio = 60.0;

// Largest depth that one step corrects, in radii [-]. Depth over dt is a velocity, which remains after the
// step. Larger: a tendon that was placed inside a bone leaves it at high speed. Smaller: the correction takes
// longer.
constexpr double kPushOut = 0.5;

// Tangential stiffness of a sticking contact: shares of the transverse stiffness of the particle together
// with N / r, which the normal force N takes from it where the tendon lies on another, and of the inertia
// divided by the squared step weight [-]. They set the displacement before sliding: of a taut tendon that
// turns by phi at a particle, mu phi / kStickingRatio of a segment; of a slack one, mu / kStickingRatio of
// the radius r. Larger: more iterations. Smaller: tendons that should stick creep first, contacts store
// energy (with 1, 6 % of what was moved), and slack strands that stand on each other tip over. A tendon that
// is laid on a slope gains the velocity g dt before its contacts are strained. It slips first where the
// friction limit exceeds the tangential weight by a share of less than about 1 / kLooseTangentRatio.
constexpr double kStickingRatio = 10.0;
constexpr double kLooseTangentRatio = 300.0;

// Normal and tangential stiffness of contacts without multipliers, over the whole stiffness of a particle
// [-]. Larger: worse conditioned. Smaller: deeper contacts.
constexpr double kSpringRatio = 10.0;
constexpr double kSpringTangentRatio = 0.1;

// Force over depth that a plane presses into a cylinder of elastic modulus E, over its length: pi E/4 (Popov
// 2010, Contact Mechanics and Friction, section 5.3) [N/m^2].
double section_stiffness(const Tendon& c) { return c.material.stiffness / (4 * c.radius * c.radius); }

// Stiffness of a particle: across the tendon, from its inertia and the tension of both segments. along: its
// springs add their slope, at least that at the reference strain.
HeldBack held_at(const Tendon& c, int i, bool along) {
  HeldBack held;
  held.inertia = held.stiffness = c.mass[i] / (c.h_eff * c.h_eff);
  for (int k : {i - 1, i}) {
    if (k < 0 || k >= c.n() - 1) continue;
    held.section += 0.5 * c.rest[k] * section_stiffness(c);
    held.stiffness += std::max(0.0, c.structure.lambda[k]) / c.rest[k];
    if (!along) continue;
    double force, slope;
    elastic_any(c.material.law, std::min(kReferenceStrain, c.material.law.toe_strain), force, slope);
    held.stiffness += std::max(c.structure.slope[k], c.material.stiffness * slope / c.rest[k]);
  }
  return held;
}

// Stiffness of a point of a segment, interpolated between its ends, so that it is continuous along the
// segment.
HeldBack held_at(const Tendon& c, const SegmentPoint& s, bool along) {
  const HeldBack one = held_at(c, s.first, along), other = held_at(c, s.first + 1, along);
  return {s.w0 * one.stiffness + s.w1 * other.stiffness, s.w0 * one.inertia + s.w1 * other.inertia, 0,
          s.w0 * one.section + s.w1 * other.section};
}

// Stiffness of a pair of points under equal and opposite forces: the harmonic mean. The compliances add, so
// that the softer point dominates. The mean is symmetric, and equals the stiffness of both points if they are
// equal.
double mean_of(double one, double other) { return one + other > 0 ? 2 * one * other / (one + other) : 0; }

HeldBack mean_of(const HeldBack& a, const HeldBack& b) {
  return {mean_of(a.stiffness, b.stiffness), mean_of(a.inertia, b.inertia), 0, mean_of(a.section, b.section)};
}

// Stiffness of a particle on a round surface where all along the arc part from it together, as where a load
// ends: a gap stretches each segment by itself times the angle of the turn [N/m].
double stiffness_of_arc(const Tendon& c, int i, Vec3 normal) {
  if (i == 0 || i == c.n() - 1) return 0;
  auto direction = [&](int k) { return unit_or(c.x.at(k + 1) - c.x.at(k), {}); };
  const double turn = dot(direction(i) - direction(i - 1), normal);
  return 0.5 * turn * turn * (c.structure.slope[i - 1] + c.structure.slope[i]);
}

// The tendon of two that is predicted to move farther.
Tendon& farther_of(Tendon& a, Tendon& b) { return b.most_motion() > a.most_motion() ? b : a; }

// Where the point x of a tendon is if it sticks to a link. A body that was put elsewhere before the step
// carries it along the surface, as one that moves there does.
Vec3 carried_point(Vec3 x, const Link& link, Vec3 normal) {
  return link.foreseen_point(x) + without(link.shifted.at(x - link.centre), normal);
}

// The contact point of a segment, and the segment, where they are if they stick to a link.
void carry(Contact& contact, const Tendon& c, const Link& link) {
  const Vec3 normal = contact.geometry.normal;
  const int k = contact.a.first;
  contact.friction.anchored_at = contact.a.w1;
  contact.friction.relative_start = carried_point(contact.a.of(c.x), link, normal);
  contact.friction.along_start =
      carried_point(c.x.at(k + 1), link, normal) - carried_point(c.x.at(k), link, normal);
}

Rot3 turn_of(const Link* link) { return link ? link->pose.rotation : Rot3{}; }

}  // namespace

// Finds the share of the substep in which nothing can pass through anything. The contacts of tunnels and
// planes are collected with it. The others take longer, and are not needed if the substep is cut.
void World::limit_motion() {
  contacts_.all.clear();
  step_.motion_limit = 1;
  for (auto [tendon, c] : filled(step_.slots)) {
    c.limited = false;
    find_near_tunnels(tendon);
    for (const int t : detection_.near_tunnels) {
      bore_contacts(tendon, t);
      mouth_contacts(tendon, t);
    }
    for (auto [s, shape] : filled(scene.shapes))
      if (!shape.half_space)
        limit_motion(c, motion_limit_of(detection_.caches[tendon][s], shape, c));
      else if (scene.filter.meets_link(tendon, shape.link))
        half_space_contacts(tendon, s);
  }
  find_pairs();
  limit_motion_of_cartilage();
}

// Adds the contacts with bones and between tendons.
void World::collect_contacts() {
  for (auto [tendon, c] : filled(step_.slots))
    for (auto [s, shape] : filled(scene.shapes))
      if (!shape.half_space) bone_contacts(tendon, s);
  for (const SegmentPair& p : detection_.pairs)
    for (int k = 0; k < p.count; ++k) pair_contact(p, p.points[k]);
  drop_contacts_of_torn();
  constrain_once();
}

// A particle is constrained by one contact at most. The others on it are springs, whose forces that one
// balances: what a body supplies along two normals is not told by the residual of the particle.
void World::constrain_once() {
  if (options.bone_contact != BoneContact::constraint) return;
  std::set<std::pair<int, int>> constrained;
  for (Contact& c : contacts_.all)
    if (c.normal_force.direct) c.normal_force.direct = constrained.emplace(c.a.tendon, particle_of(c)).second;
}

// share: of the substep, in which a tendon can pass through nothing.
void World::limit_motion(Tendon& c, double share) {
  step_.motion_limit = std::min(step_.motion_limit, share);
  c.limited |= share < 1;
}

// Nothing is left of a torn segment but its ends.
void World::drop_contacts_of_torn() {
  auto bears = [&](const SegmentPoint& at) {
    return at.tendon < 0 || at.w0 == 0 || at.w1 == 0 || !step_.slots[at.tendon]->is_torn(at.first);
  };
  const bool any = std::any_of(step_.slots.begin(), step_.slots.end(),
                               [](const Tendon* c) { return c && !c->torn.empty(); });
  if (!any) return;
  remove_where(contacts_.all, [&](const Contact& c) { return !bears(c.a) || !bears(c.b); });
}

// Gap that may remain at the end of the substep [m], negative where there is depth now. The substep corrects
// its share of the depth that the whole step corrects, which is at most `most` [m]. Over a round surface,
// the depth is that of the point of the segment which is nearest now. Where the solution does not move, the
// contact is there, and not at the point that is predicted to be nearest: a depth that was not left would be
// corrected at once, however short the substep is. Where a tendon slides through a mouth, the point that will
// be at the edge is less deep now. More depth than that is not left: a tendon that mouths squeeze would sink
// deeper into the edge as it slides.
double World::depth_to_leave(const Contact& contact, double most) const {
  Contact now = contact;
  Vec3 point = contact.friction.relative_start;
  if (now.is_round()) {
    const Vec3 along = contact.friction.along_start, start = point - contact.a.w1 * along;
    now.follow(start, start + along);
    point = start + now.a.w1 * along;
  }
  now.evaluate(point, true);
  const double depth = std::max(0.0, -now.geometry.gap), share = step_.substeps.share_left();
  const double left = most * (1 - step_.substeps.share_before());  // correction left to the remaining step
  return -(depth - share * std::min(depth, left));
}

// Adds a contact with a link. friction: of the surface, or negative (Link::friction_of).
void World::add_link_contact(Contact& contact, int link_slot, double friction) {
  const Tendon& c = *step_.slots[contact.a.tendon];
  const Link& link = scene.links[link_slot];
  contact.link = link_slot;
  contact.friction.coefficient = link.friction_of(friction) * c.friction;
  carry(contact, c, link);
  const int particle = contact.a.w0 >= 0.5 ? contact.a.first : contact.a.first + 1;
  contact.geometry.radius = c.radius;
  HeldBack held = held_at(c, particle, !carries(options));
  // In steps that hold the bodies no load ends, and without inertia stiffer contacts take more iterations.
  if (contact.is_round() && !step_.whole) held.arc = stiffness_of_arc(c, particle, contact.geometry.normal);
  finish_contact(contact, held, c.radius);
  if (!overruled(contact, c, scene.links) && !is_contradicted(contact)) contacts_.all.push_back(contact);
}

// Sets stiffness, depth allowance and warm start of a contact.
void World::finish_contact(Contact& contact, const HeldBack& held, double radius) {
  const bool carries = bt::carries(options), chosen = options.contact_stiffness > 0;
  if (chosen)
    contact.normal_force.stiffness = options.contact_stiffness;
  else if (!carries)  // without multipliers only stiffness limits the depth
    contact.normal_force.stiffness = kSpringRatio * held.stiffness;
  else
    contact.normal_force.stiffness = kContactRatio * held.stiffness + held.arc;
  // The inertia term makes a particle without tension stick before it gains speed.
  contact.friction.stiffness = carries ? kStickingRatio * held.stiffness + kLooseTangentRatio * held.inertia
                                       : kSpringTangentRatio * held.stiffness;
  if (contact.link >= 0) set_arm(contact);
  contact.normal_force.first_stiffness = carries && !chosen ? contact.normal_force.stiffness : 0;
  contact.normal_force.section = held.section;
  double most = kPushOut * radius;
  if (contact.link >= 0) {
    // A body that was put elsewhere before the step pushes by as much, as one that moves there does. Beyond a
    // radius it may have passed the centreline, and the normal says nothing.
    const Link& link = scene.links[contact.link];
    const Vec3 shifted = link.put.at(contact.a.of(step_.slots[contact.a.tendon]->x) - link.centre);
    most += std::min(std::max(dot(shifted, contact.geometry.normal), 0.0), radius);
  }
  contact.geometry.depth_to_leave = depth_to_leave(contact, most);
  contact.geometry.depth_allowance = contact.geometry.depth_to_leave;
  recall(contact, held.inertia);
}

bool World::turns_far(const Link& link) const {
  const GeneralizedBody* m = body_of(link);
  return m && m->turning.far;
}

// Friction and normal force act on the centreline, because particles do not spin. The arm is that
// of the predicted end, to which the normal belongs: a smooth wheel is then turned by nothing, and a ball
// that rolls is not driven on. Where rotations of free bodies are not finite in this step, their arm is that
// of the start of the substep: implicit Euler keeps the angular momentum of both with it. Tendons that are
// brought to rest among held bodies have no momentum.
void World::set_arm(Contact& contact) const {
  const Tendon& c = *step_.slots[contact.a.tendon];
  const Link& link = scene.links[contact.link];
  const bool far = turns_far(link);
  contact.at_start = link.jacobian.empty() && !far && !link.attachment_arms.at_end && !step_.whole;
  Vec3 end = contact.a.of(contact.at_start ? c.x : c.predicted);
  const Vec3 centre = contact.at_start ? link.centre : link.centre + link.foreseen.all.linear;
  if (contact.acts_at_centre()) end = contact.geometry.rim.centre;
  contact.arm = end - centre;
  contact.rim_arm = contact.geometry.rim.centre - centre;
  if (!far) return;
  contact.arm = transposed_times(link.foreseen.turn, contact.arm);
  contact.rim_arm = transposed_times(link.foreseen.turn, contact.rim_arm);
}

// Whether an anchor is where a contact with a body forbids it. Such a contact has no solution. Attachments
// count like rigid anchors, because they stay near their target.
bool World::is_contradicted(const Contact& contact) const {
  const Tendon& c = *step_.slots[contact.a.tendon];
  for (int e : {0, 1}) {
    if ((e ? contact.a.w1 : contact.a.w0) == 0) continue;
    const Anchor* anchor = fixed_anchor(c, contact.a.first + e);
    if (!anchor) continue;
    // Near an attachment to the same link, the contact keeps the distance that the attachment leaves it.
    if (anchor->link == contact.link && (e ? contact.a.w0 : contact.a.w1) >= kLeastEndWeight) continue;
    Contact at_hold = contact;
    at_hold.evaluate(anchor->target.aim, true);
    if (at_hold.geometry.gap < 0 && !at_hold.is_closed() && !is_beside(*anchor, contact)) return true;
  }
  return false;
}

// Whether an anchor that is beneath the plane of a contact of its segment clears the shape: the plane goes on
// beyond the face that the segment touches.
bool World::is_beside(const Anchor& anchor, const Contact& contact) const {
  const ContactKey& key = contact.key;
  if (key.kind != ContactKind::bone) return false;
  const Shape& shape = *scene.shapes[key.other];
  if (shape.half_space || anchor.link == shape.link) return false;
  const NearCache& cache = detection_.caches[key.tendon][key.other];
  // Within a mesh its surface can be out of reach.
  return !cache.entries[anchor.particle].wanted && (shape.primitive || !cache.entries[key.feature].inside);
}

const ContactMemory* World::remembered(const ContactKey& key) const {
  const auto found = std::lower_bound(contacts_.memory.begin(), contacts_.memory.end(), key,
                                      [](const ContactMemory& m, const ContactKey& k) { return m.key < k; });
  return found != contacts_.memory.end() && found->key == key ? &*found : nullptr;
}

void World::recall(Contact& contact, double inertia) {
  const ContactMemory* found = remembered(contact.key);
  if (!found) return;
  const Rot3 turn = turn_of(contact.link >= 0 ? &scene.links[contact.link] : nullptr);
  const bool carries =
      bt::carries(options) && options.contact_stiffness == 0;  // the paper's spring has no multiplier
  // It stays in the plane in which it was found. The point where this contact was detected may be far along
  // its segment from the one that touches: in the plane there, it would lose a part in every step.
  contact.friction.anchor = turn * found->tangent_anchor;
  if (carries) {
    contact.bear(found->load, kStickingRatio);
    // The tangential stiffness depends on the step weight. Scaling the anchor keeps the friction force.
    const double more = inertia * (std::pow(step_.slots[contact.a.tendon]->h_eff / found->h_eff, 2) - 1);
    const double per_inertia = kStickingRatio + kLooseTangentRatio;
    contact.friction.anchor = (1 + per_inertia * more / contact.friction.stiffness) * contact.friction.anchor;
    contact.normal_force.lambda = found->lambda_confirmed;
    contact.normal_force.first_gap = found->squeezed_gap;
    if (found->squeezed_gap < 0) contact.bear_by_section(Squeezed::before);
  }
  contact.friction.anchor += moved_since_held(contact);
  contact.normal_force.lambda_previous = found->lambda;
  contact.normal_force.lambda_predicted = contact.normal_force.lambda_previous;
  contact.force.last_mean = found->mean_force;
  contact.force.last_given = found->given_force;
  contact.limit_friction(contact.normal_force.lambda_previous);
  contact.friction.sliding = found->sliding;
}

void World::remember() {
  remove_where(contacts_.memory, [&](const ContactMemory& m) { return step_.slots[m.key.tendon]; });
  contacts_.touching.assign(step_.slots.size(), 0);
  for (auto [slot, c] : filled(step_.slots)) c.touched = false;
  for (const Contact& contact : contacts_.all) {
    if (contact.normal_force.value <= 0) continue;
    for (const int tendon : {contact.a.tendon, contact.b.tendon}) {
      if (tendon < 0) continue;
      step_.slots[tendon]->touched = true;
      contacts_.touching[tendon] += hash_of(contact.key);
    }
    const Rot3 turn = turn_of(contact.link >= 0 ? &scene.links[contact.link] : nullptr);
    const double now = contact.normal_force.value, previous = contact.normal_force.lambda_previous;
    const bool closed = contact.is_closed();
    const bool squeezed = contact.normal_force.squeezed != Squeezed::no;
    const double confirmed = squeezed      ? contact.normal_force.lambda
                             : step_.whole ? now
                                           : std::min(now, previous);
    contacts_.memory.push_back({contact.key, now, confirmed, closed ? confirmed : 0,
                                squeezed ? contact.geometry.gap : 0, contact.friction.sliding,
                                contact.force.mean, contact.force.given, step_.slots[contact.a.tendon]->h_eff,
                                transposed_times(turn, contact.friction.displacement),
                                transposed_times(turn, contact.geometry.normal)});
  }
  std::sort(contacts_.memory.begin(), contacts_.memory.end(),
            [](const ContactMemory& a, const ContactMemory& b) { return a.key < b.key; });
  for (auto [slot, c] : filled(step_.slots)) {
    c.smooth = c.touching == contacts_.touching[slot];
    c.touching = contacts_.touching[slot];
  }
  for (GeneralizedBody& m : scene.bodies) m.history.smooth = true;
}

// Algorithm 1, steps 3 and 4.
void World::find_pairs() {
  const auto start = std::chrono::steady_clock::now();
  detection_.pairs.clear();
  const Foresight foresight = step_.substeps.divisible() ? Foresight::swept : Foresight::near;
  step_.report.pairs = detection_.broad_phase.find(step_.slots, scene.filter, options.contact_threshold,
                                                   foresight, detection_.pairs);
  step_.report.search_seconds +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  for (const SegmentPair& p : detection_.pairs)
    if (p.room < 1) limit_motion(farther_of(*step_.slots[p.tendon_a], *step_.slots[p.tendon_b]), p.room);
}

void World::pair_contact(const SegmentPair& p, const PairPoint& at) {
  const Tendon &a = *step_.slots[p.tendon_a], &b = *step_.slots[p.tendon_b];
  const double radii = a.radius + b.radius, apart = contact_distance(p, at, a, b, scene.links);
  if (apart < kNearlyMet * radii) return;
  Contact contact;
  contact.key = {ContactKind::tendon, p.tendon_a, p.segment_a, p.tendon_b, p.segment_b, at.end};
  contact.a = {p.tendon_a, p.segment_a, 1 - at.u, at.u};
  contact.b = {p.tendon_b, p.segment_b, 1 - at.w, at.w};
  const Vec3 along = a.x.at(p.segment_a + 1) - a.x.at(p.segment_a);
  contact.geometry.normal = at.distance > 1e-9 * a.radius ? (1 / at.distance) * at.apart
                                                          : any_perpendicular(unit_or(along, {1, 0, 0}));
  contact.geometry.offset = apart + options.contact_threshold;
  contact.geometry.margin = contact.geometry.offset - radii;
  contact.friction.coefficient = a.friction * b.friction;
  contact.friction.relative_start = at.apart;
  contact.friction.anchored_at = at.u;
  contact.friction.anchored_at_other = at.w;
  contact.begin_pair(along, b.x.at(p.segment_b + 1) - b.x.at(p.segment_b));
  contact.geometry.parallel = p.parallel;
  contact.geometry.radius = radii;
  auto held = [&](const Tendon& c, const SegmentPoint& at) { return held_at(c, at, !carries(options)); };
  finish_contact(contact, mean_of(held(a, contact.a), held(b, contact.b)), std::min(a.radius, b.radius));
  if (!overruled(contact, a, b, scene.links)) contacts_.all.push_back(contact);
}

namespace {}  // namespace

}  // namespace bt
