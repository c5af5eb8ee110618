// Builds the contacts of a substep from the detected distances, and keeps the contact memory.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <type_traits>
#include <vector>

#include "math/rounding.h"
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

// A segment gets its own contact where its interior is nearer to a surface than its ends are, by more than
// this many radii [-]. Larger: round bones penetrate deeper between particles. Smaller: on flat bones each
// segment has three contacts, whose shares of the load depend on rounding errors.
constexpr double kNoBulge = 1e-5;

// A segment on a round surface has a point that is nearest to it where it turns around it by so much that its
// interior is this many radii nearer than its ends [-]. Smaller: the point of a segment along a cylinder is
// anywhere on it, by rounding, and contacts do not converge. Larger: small wheels feel chords.
constexpr double kAcross = 2e-3;

// Sine of the angle between a segment and a surface up to which it lies along it [-]. Larger: what hangs over
// an edge is measured from the face. Smaller: a body tips over one end of a long segment within a step.
constexpr double kAlong = 0.1;

// Change of that sine which is an edge [-]. Larger: the ends of a capsule count as its side. Smaller:
// rounding does.
constexpr double kEdge = 0.01;

// Length of the part of a segment that lies along a surface, over the radius, up to which it counts as a
// point [-]. Smaller: where a segment turns around a wheel, the surface hardly bends over so short a part.
constexpr double kShortest = 3;

// Bisections by which the end of the part of a segment that lies along a surface is found.
constexpr int kBisections = 12;

// Largest bend of a segment, over that with which all of it is equally near to the edge of a mouth, so that
// it has no nearest point [-]. Smaller: a coarse tendon is felt to turn at its particles.
constexpr double kBend = 0.5;

// Distance over that at which a tendon lies on an elliptic edge, up to which the edge keeps its shape where
// the tendon touches both halves, over the tendon's clearance in the bore [-]. Smaller: where the tendon is
// hardly wider than the narrow end, the surface on which its centreline lies bends too sharply for Newton's
// method. Larger: the tendon is wedged where it only begins to touch both halves.
constexpr double kRounded = 0.05;

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

// Whether the part of segment k that can touch a shape is nearer to what it keeps than the segment's ends,
// which have contacts of their own where they belong to that part. kept: of the segment's point u [m].
template <class Kept>
bool bulges(const NearCache& cache, int n, int k, double radius, const Stretch& part, Kept kept) {
  const Plane& e = cache.entries[n + k].now;
  if (e.u <= 1e-6 || e.u >= 1 - 1e-6) return false;
  auto height = [](const Plane& at, Vec3 x) { return dot(at.normal, x - at.point); };
  const Vec3 a = cache.local[k], b = cache.local[k + 1];
  const double inside = height(e, (1 - e.u) * a + e.u * b) - kept(e.u) + kNoBulge * radius;
  auto touches = [&](int i) {
    return cache.entries[i].wanted && height(cache.entries[i].now, cache.local[i]) - kept(i - k) <= inside;
  };
  return !(part.from == 0 && touches(k)) && !(part.to == 1 && touches(k + 1));
}

// Whether the part of a segment that is beside a round surface turns around it, else lies along it.
bool is_across(const Tangent& surface, Vec3 segment, double radius) {
  const Vec3 across = surface.share * without(segment, surface.axis);
  return dot(across, across) > 8 * kAcross * radius * surface.radius;
}

// A segment where it is predicted at the end of the substep, over a surface (shape frame). near: the
// triangles of a mesh.
struct SegmentOver {
  const Shape& shape;
  const Surface* surface;
  const Entry& near;
  const Stretch part;  // that can touch it
  Vec3 a, b, along;

  Vec3 at(double u) const { return (1 - u) * a + u * b; }
  double lean(Vec3 normal) const { return dot(normal, along); }

  // The plane at the point of the surface that is nearest to the one at u.
  Plane below(double u) const {
    const Vec3 x = at(u);
    const Vec3 foot =
        shape.primitive ? shape.primitive.nearest(x, x).point : surface->nearest(near.nearby, x, x).point;
    return {foot, unit_or(x - foot, near.now.normal), u};
  }

  // Whether the surface leans to the segment at u by as much.
  bool goes_on(double u, double leans) const {
    return u >= part.from && u <= part.to && std::fabs(lean(below(u).normal) - leans) < kEdge;
  }

  // How far from u towards one of its ends the surface leans to it by as much.
  double end_towards(double end, double u, double leans) const {
    if (goes_on(end, leans)) return end;
    for (int i = 0; i < kBisections; ++i) {
      const double between = 0.5 * (u + end);
      (goes_on(between, leans) ? u : end) = between;
    }
    return u;
  }

  // The planes at the ends of the part that lies along the surface, if one does that is longer than
  // `shortest` [-]. The nearest point can be at its edge: half of that aside, on one side or on the other, is
  // within the part. There the same holds, so that few points tell that there is none.
  std::optional<std::pair<Plane, Plane>> ends(double shortest) const {
    const double half = 0.5 * shortest, nearest = near.now.u, at_nearest = lean(below(nearest).normal);
    for (const double aside : {-half, half}) {
      const double u = nearest + aside;
      if (u < part.from || u > part.to) continue;
      const double leans = lean(below(u).normal);
      if (std::fabs(leans) >= kAlong) continue;
      if (std::fabs(at_nearest - leans) >= kEdge && !goes_on(u + aside, leans)) continue;
      const double from = end_towards(part.from, u, leans), to = end_towards(part.to, u, leans);
      if (to - from > shortest) return std::pair{below(from), below(to)};
    }
    return {};
  }

  // Whether the part between two planes turns around a round surface.
  bool turns(const Plane& from, const Plane& to, double radius) const {
    if (!shape.primitive.is_round()) return false;
    const Plane middle = below(0.5 * (from.u + to.u));
    const Primitive::Round round = shape.primitive.round_at(middle.point, middle.normal);
    return round.radius > 0 &&
           is_across({middle.point, middle.normal, round.axis, round.radius, to.u - from.u}, b - a, radius);
  }
};

// Whether particles hold a body beside segment k, which lies along it: both of the segment's, or one of them
// and the one before or after it.
bool is_held_by_particles(const NearCache& cache, const SegmentOver& over, int k, int n) {
  auto holds = [&](int i) {
    return i >= 0 && i < n && cache.entries[i].wanted &&
           std::fabs(over.lean(cache.entries[i].now.normal)) < kAlong;
  };
  const bool first = over.part.from == 0 && holds(k), last = over.part.to == 1 && holds(k + 1);
  return (first && (last || holds(k - 1))) || (last && holds(k + 2));
}

// The planes of a surface at the ends of the part of segment k that lies along it, where these are inside the
// segment. `surface` is that of a mesh. A body that is shorter than two segments would tip over the nearest
// point alone within a step.
std::vector<Plane> ends_along(NearCache& cache, const Shape& shape, const Surface* surface, const Tendon& c,
                              int k, const Stretch& part, const Pose& end) {
  Entry& e = cache.entries[c.n() + k];
  if (e.inside || !(shape.primitive || surface)) return {};
  const Vec3 a = to_local(end, c.predicted.at(k)), b = to_local(end, c.predicted.at(k + 1));
  const double length = norm(b - a), shortest = kShortest * c.radius;
  if (length <= shortest) return {};
  const SegmentOver over{shape, surface, e, part, a, b, unit_or(b - a, {})};
  if (is_held_by_particles(cache, over, k, c.n())) return {};
  if (!shape.primitive) list_within_reach(e, cache.local[k], cache.local[k + 1], *surface);
  const auto ends = over.ends(shortest / length);
  if (!ends) return {};
  const auto& [from, to] = *ends;
  const bool between = std::min(e.now.u - from.u, to.u - e.now.u) * length > c.radius;
  if (between && over.turns(from, to, c.radius)) return {};
  std::vector<Plane> inside;
  for (Plane plane : {from, to}) {
    if (plane.u == 0 || plane.u == 1) continue;
    // Perpendicular to the segment: what slides along it over an edge is not held back.
    const double side = dot(plane.normal, e.now.normal) < 0 ? -1 : 1;
    plane.normal = side * unit_or(without(plane.normal, over.along), e.now.normal);
    inside.push_back(plane);
  }
  return inside;
}

// Whether the point of segment k that is nearest to a round surface is predicted to be inside the segment at
// the end of the substep. A body that rolls along a tendon then presses on a segment that it does not touch
// yet. Without a contact there, the last segment's end would carry it from behind.
bool will_bulge(const NearCache& cache, const Shape& shape, const Tendon& c, int k, const Pose& end) {
  if (!shape.primitive.is_round() || !cache.entries[c.n() + k].wanted) return false;
  const Vec3 start = to_local(end, c.predicted.at(k)), way = to_local(end, c.predicted.at(k + 1)) - start;
  const Tangent surface = tangent_of(cache, shape, c.n() + k, start);
  if (surface.radius == 0 || !is_across(surface, way, c.radius)) return false;
  const Vec3 across = without(way, surface.axis);
  const double at = dot(surface.point - surface.radius * surface.normal - start, across);
  return at > 0 && at < dot(across, across);
}

// The plane of the other side, within reach, if a particle or a segment a-b (shape frame) is in a valley of a
// mesh; `here`: the plane of the side that is nearest. With one side at a time, it would change sides from
// step to step, and sink between them. The interior of a segment has a plane of its own there where it is
// nearer to that side than its ends are; a point a = b of it, where it is.
std::optional<Plane> across_valley(const Entry& e, const Surface* surface, Vec3 a, Vec3 b, const Plane& here,
                                   double radius) {
  const Vec3 out = (1 - here.u) * a + here.u * b - here.point;
  if (!surface || e.inside || norm(out) == 0) return {};
  auto across = [&](Vec3 from, Vec3 to) {
    return surface->across_valley(e.nearby, from, to, here.point, out, e.reach);
  };
  const ValleySide side = across(a, b);
  if (side.nearest.distance > e.reach) return {};
  const double at_ends = side.nearest.distance + kNoBulge * radius;
  const bool segment = norm(b - a) > 0;
  if (segment && (across(a, a).nearest.distance <= at_ends || across(b, b).nearest.distance <= at_ends))
    return {};
  return Plane{side.nearest.point, side.normal, segment ? side.nearest.u : here.u};
}

// Greatest predicted motion of a particle in the substep [m].
double most_motion(const Tendon& c) {
  double most = 0;
  for (int i = 0; i < c.n(); ++i) most = std::max(most, norm(c.predicted.at(i) - c.x.at(i)));
  return most;
}

// The tendon of two that is predicted to move farther.
Tendon& farther_of(Tendon& a, Tendon& b) { return most_motion(b) > most_motion(a) ? b : a; }

Tangent in_world(const Tangent& surface, const Pose& pose) {
  return {to_world(pose, surface.point), pose.rotation * surface.normal, pose.rotation * surface.axis,
          surface.radius, surface.share};
}

// Where a frame that is fixed to a link is foreseen to be at the end of the substep.
Pose foreseen_pose(const Pose& frame, const Link& link) {
  const Rot3& turn = link.foreseen.turn;
  return {turn * frame.rotation,
          link.centre + link.foreseen.all.linear + turn * (frame.origin - link.centre)};
}

// Where a point of a link is foreseen to be. If the link does not turn far, the point moves linearly, as
// attachments do.
Vec3 foreseen_point(Vec3 x, const Link& link) {
  return link.foreseen.far ? foreseen_pose({{}, x}, link).origin : x + link.foreseen_at(x);
}

// Where the point x of a tendon is if it sticks to a link. A body that was put elsewhere before the step
// carries it along the surface, as one that moves there does.
Vec3 carried_point(Vec3 x, const Link& link, Vec3 normal) {
  return foreseen_point(x, link) + without(link.shifted.at(x - link.centre), normal);
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

Rim foreseen_rim(const Rim& rim, const Link& link) {
  const Vec3 axis = unit_or(link.foreseen.turn * rim.axis, rim.axis);
  const Vec3 slope = without(link.foreseen.turn * rim.slope, axis);
  Rim foreseen = rim_of(foreseen_point(rim.centre, link), axis, rim.radius, slope);
  foreseen.half = rim.half;
  foreseen.end_c = rim.end_c;
  foreseen.end_s = rim.end_s;
  return foreseen;
}

// A particle as a point of a segment.
SegmentPoint particle_of(const Tendon& c, int tendon, int i) {
  return i < c.n() - 1 ? SegmentPoint{tendon, i, 1, 0} : SegmentPoint{tendon, i - 1, 0, 1};
}

// Second difference of the particles at i [m].
Vec3 bend_of(const Tendon& c, int i) {
  if (i == 0 || i == c.n() - 1) return {};
  return c.x.at(i + 1) - c.x.at(i) - (c.x.at(i) - c.x.at(i - 1));
}

// Largest distance of a tendon from its chords, where it bends at particles first ... last [m].
double most_bulge(const Tendon& c, int first, int last) {
  double square = 0;
  for (int i = first; i <= last; ++i) {
    const Vec3 bend = bend_of(c, i);
    square = std::max(square, dot(bend, bend));
  }
  return kBulgeAtEnd * std::sqrt(square);
}

// Largest bend of segment k that lies on a rim, `kept` from it [m]. The second derivative of their distance
// along the segment is l^2 share / kept, less the bend. Its share of that of a straight edge across is less
// where the segment goes along the edge, changes along the segment, and is another on each side of an
// ellipse. It changes the faster the smaller it is, so that it is taken twice.
double most_bend(const Tendon& c, int k, Rim rim, double kept) {
  const Vec3 l = c.x.at(k + 1) - c.x.at(k);
  const double square = dot(l, l);
  if (square == 0) return 0;
  auto share = [&](Vec3 x) {
    const RimPoint edge = nearest_on_rim(rim, x);
    const double straight = 1 - kept * dot(unit_or(x - edge.point, {}), edge.curvature);
    const double along = dot(l, edge.tangent);
    return straight > 0 ? std::max(0.0, 1 - along * along / (straight * square)) : 0;
  };
  double least = 1;
  for (int half : {1, -1}) {
    if (!rim.is_circle()) rim.half = half;
    for (double u : {0.25, 0.5, 0.75}) least = std::min(least, share(c.x.at(k) + u * l));
    if (rim.is_circle()) break;
  }
  return kBend * least * least * square / kept;
}

// Bends of a tendon at a mouth: the second differences, as far as both segments with i that lie on the edge
// have one nearest point to it, and as the particle has room in the bore on the other side. `kept`: distance
// from the edge at which they lie [m]. Particles are asked for in their order: what two ask for is kept.
class BendsAtMouth {
 public:
  BendsAtMouth(const Tendon& c, const Rim& rim, double kept) : c_(c), rim_(rim), kept_(kept) {}
  const Rim& rim() const { return rim_; }
  Vec3 at(int i) {
    if (i != particle_) bend_ = find(i);
    particle_ = i;
    return bend_;
  }

 private:
  Vec3 find(int i) {
    const Vec3 bend = bend_of(c_, i);
    const double size = norm(bend);
    if (kBulgeAtEnd * size <= kNoBulge * c_.radius) return {};
    const double room = std::max(0.0, rim_.radius - kept_) / kBulgeAtEnd;
    const double most = std::min({room, most_of(i - 1), most_of(i)});
    return std::min(1.0, most / size) * bend;
  }
  double most_of(int k) {
    if (k != segment_) most_ = most_bend(c_, k, rim_, kept_);
    segment_ = k;
    return most_;
  }
  const Tendon& c_;
  const Rim rim_;
  const double kept_;
  int particle_ = -1, segment_ = -1;
  Vec3 bend_;
  double most_ = 0;
};

// Bend at particle i of a bore, if a segment of it can reach a mouth [m].
Vec3 bend_beside(const Tendon& c, int i, BendsAtMouth (&mouths)[2]) {
  const double longest = std::max(i > 0 ? c.rest[i - 1] : 0, i + 1 < c.n() ? c.rest[i] : 0);
  for (BendsAtMouth& mouth : mouths)
    if (std::fabs(mouth.rim().height(c.x.at(i))) < longest) return mouth.at(i);
  return {};
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

// Distance of a point of a tendon from a shape that it touches [m]; less than the radius near attachments.
double World::distance_to_keep(const SegmentPoint& spot, const ContactKey& key) const {
  const Tendon& c = *step_.slots[spot.tendon];
  const Shape& shape = *scene.shapes[key.other];
  double apart = c.radius;
  for (const Anchor& h : c.anchors)
    if (h.link == shape.link && !h.is_line)
      apart = std::min(apart, contact_distance(c, spot.first, spot.w1,
                                               {h.particle, distance_from(shape, key, h.particle)}));
  return apart;
}

// Distance of a particle from a shape that its tendon is near [m], or more; negative inside, but of an open
// mesh. Of one that was never measured no distance is known: it is on the surface, beyond reach, or in a
// bore.
double World::distance_from(const Shape& shape, const ContactKey& key, int particle) const {
  if (shape.half_space) {
    const Pose pose = in_world(shape, scene.links[shape.link]);
    return dot(shape.plane_normal, to_local(pose, step_.slots[key.tendon]->x.at(particle))) -
           shape.plane_offset;
  }
  const NearCache& cache = detection_.caches[key.tendon][key.other];
  if (shape.primitive)
    for (const Departure& from : cache.departures)
      if (from.particle == particle) return from.distance;
  const Entry& e = cache.entries[particle];
  if (!e.known) return e.inside ? 0 : HUGE_VAL;
  const bool buried = !cache.buried.empty() && cache.buried[particle];
  return (buried ? -e.distance : e.distance) + norm(cache.local[particle] - e.a);
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

void World::bone_contacts(int tendon, int s) {
  const Tendon& c = *step_.slots[tendon];
  const Shape& shape = *scene.shapes[s];
  const Link& link = scene.links[shape.link];
  NearCache& cache = detection_.caches[tendon][s];
  std::vector<Entry>& entries = cache.entries;
  if (std::none_of(entries.begin(), entries.end(), [](const Entry& e) { return e.wanted; })) return;
  const Pose end = foreseen_pose(in_world(shape, link), link);
  const Surface* surface = surface_for(c, s);
  const int n = c.n();
  for (int f = 0; f < static_cast<int>(entries.size()); ++f) {
    Entry& e = entries[f];
    if (!e.wanted) continue;
    const bool segment = f >= n;
    const ContactKey key{ContactKind::bone, tendon, f, s};
    const Stretch part = segment ? touching_part(c, f - n, cache.departures) : Stretch{};
    const std::vector<Plane> ends =
        segment ? ends_along(cache, shape, surface, c, f - n, part, end) : std::vector<Plane>{};
    for (int k = 0; k < static_cast<int>(ends.size()); ++k) {
      const SegmentPoint at{tendon, f - n, 1 - ends[k].u, ends[k].u};
      const Vec3 ahead = to_local(end, at.of(c.predicted));
      const Tangent beside = in_world({ends[k].point, ends[k].normal}, end);
      both_sides(at, key, 2 * (k + 1), beside, across_valley(e, surface, ahead, ahead, ends[k], c.radius),
                 end);
    }
    const auto kept = [&](double u) { return distance_to_keep({tendon, f - n, 1 - u, u}, key); };
    if (segment && !bulges(cache, n, f - n, c.radius, part, kept) && !will_bulge(cache, shape, c, f - n, end))
      continue;
    const SegmentPoint at =
        segment ? SegmentPoint{tendon, f - n, 1 - e.now.u, e.now.u} : particle_of(c, tendon, f);
    const Vec3 from = cache.local[segment ? f - n : f], to = segment ? cache.local[f - n + 1] : from;
    if (surface && !e.inside) list_within_reach(e, from, to, *surface);
    const auto other = across_valley(e, surface, from, to, e.now, c.radius);
    if (!ends.empty() && !other) continue;  // a valley holds a segment where it touches both sides
    const Tangent beside = in_world(tangent_of(cache, shape, f, to_local(end, at.of(c.predicted))), end);
    both_sides(at, key, 0, beside, other, end);
  }
}

// With the nearest side of a surface and, in a valley, with the other one. first: the end of the key of the
// first of both.
void World::both_sides(const SegmentPoint& at, ContactKey key, int first, const Tangent& beside,
                       const std::optional<Plane>& other, const Pose& end) {
  key.end = first;
  if (other) {
    const Tangent side = in_world({other->point, other->normal}, end);
    ContactKey across = key;
    (last_faced(key, side.normal, beside.normal) ? key : across).end = first + 1;
    const bool segment = key.feature >= step_.slots[at.tendon]->n();
    bone_contact(segment ? SegmentPoint{at.tendon, at.first, 1 - other->u, other->u} : at, across, side);
  }
  bone_contact(at, key, beside);
}

// With a plane or a round surface, given where it is foreseen to be at the end of the substep.
void World::bone_contact(const SegmentPoint& spot, const ContactKey& key, const Tangent& surface) {
  const Shape& shape = *scene.shapes[key.other];
  const Tendon& c = *step_.slots[spot.tendon];
  Contact contact;
  contact.key = key;
  contact.a = spot;
  const Vec3 segment = c.x.at(spot.first + 1) - c.x.at(spot.first);
  const bool round = surface.radius > 0 && is_across(surface, segment, c.radius);
  if (key.feature >= c.n()) {
    contact.geometry.slides =
        touching_part(c, spot.first, detection_.caches[key.tendon][key.other].departures);
    contact.slide_to(contact.a.w1);
  }
  const double apart = distance_to_keep(contact.a, key), kept = apart + options.contact_threshold;
  // It may be inside, on its way out from an attachment. There, no face of a solid is the one to leave it by.
  if (shape.primitive && apart < -kRoundingShare * c.radius) return;
  contact.geometry.normal = surface.normal;
  contact.geometry.offset = dot(surface.normal, surface.point) + kept;
  if (round)
    contact.geometry.rim =
        rim_of(surface.point - surface.radius * surface.normal, surface.axis, surface.radius + kept, {});
  contact.geometry.margin = kept - c.radius;
  contact.normal_force.direct = key.feature < c.n() && options.bone_contact == BoneContact::constraint &&
                                !scene.links[shape.link].yields();
  add_link_contact(contact, shape.link, shape.friction);
}

// Whether the normal of a contact in the last step was nearer to one normal than to another.
bool World::last_faced(const ContactKey& key, Vec3 one, Vec3 other) const {
  const ContactMemory* last = remembered(key);
  return last &&
         dot(scene.links[scene.shapes[key.other]->link].pose.rotation * last->normal, one - other) > 0;
}

void World::half_space_contacts(int tendon, int s) {
  const Tendon& c = *step_.slots[tendon];
  const Shape& shape = *scene.shapes[s];
  const Link& link = scene.links[shape.link];
  const Pose pose = in_world(shape, link), end = foreseen_pose(pose, link);
  const Vec3 normal = pose.rotation * shape.plane_normal;
  const double offset = shape.plane_offset + dot(normal, pose.origin);
  for (int i = 0; i < c.n(); ++i) {
    Vec3 x = c.x.at(i);
    double height = dot(normal, x) - offset;
    if (height > reach_of(c, i, link, options.contact_threshold)) continue;
    const Vec3 foot = to_world(end, to_local(pose, x - height * normal));
    bone_contact(particle_of(c, tendon, i), {ContactKind::bone, tendon, i, s},
                 {foot, end.rotation * shape.plane_normal});
  }
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

// Algorithm 2: the tunnels in which particles are, and the contacts of bores and mouths.

void World::find_bores() {
  detection_.bores.resize(scene.tunnels.size());
  detection_.bores_by_link.resize(scene.links.size());
  for (auto& list : detection_.bores_by_link) list.clear();
  for (auto [t, tunnel] : filled(scene.tunnels)) {
    detection_.bores[t] = in_world(tunnel, scene.links[tunnel.link].pose);
    detection_.bores[t].tunnel = static_cast<int>(t);
    detection_.bores_by_link[tunnel.link].push_back(detection_.bores[t]);
  }
  if (scene.tunnels.empty()) return;
  for (auto [tendon, c] : filled(step_.slots)) classify(tendon);
}

bool World::may_enter(int tendon, int tunnel) const {
  const auto& t = scene.tunnels[tunnel];
  return t && t->radius > scene.tendons[tendon]->radius && scene.filter.meets_link(tendon, t->link);
}

namespace {

// Whether a stretch of particles that is within a bore is there through one of its mouths: the tendon leaves
// it there at one of its ends, or does not leave it. What comes from the side is no more inside than what
// passes beside the bore: an eyelet need not have bone around it.
bool came_through_mouth(const Tendon& c, const Bore& bore, int first, int last) {
  auto leaves_by_mouth = [&](int inside, int outside) {
    const Vec3 x = c.x.at(inside), y = c.x.at(outside);
    return bore.beyond(x + bore.leaves(x, y) * (y - x)) >= -(bore.chamfer + c.radius);
  };
  const bool begins = first == 0, ends = last == c.n() - 1;
  return (begins && ends) || (!begins && leaves_by_mouth(first, first - 1)) ||
         (!ends && leaves_by_mouth(last, last + 1));
}

}  // namespace

// Algorithm 2, step 1. A particle enters a bore when it is within the bore's radius and came through a mouth.
// It belongs to the bore until it is beyond a mouth, even if a step moves it farther from the axis. So does a
// segment that the bore is shorter than, until its ends are not beyond both mouths. What is next to a
// particle in the bore, and before both mouths, is in the bore too: the segment between them passes no mouth.
// A body that turns by much in a step would press it out of the bore from beside, and in from its wall.
void World::classify(int tendon) {
  Tendon& c = *step_.slots[tendon];
  const Box box = box_of(c.x);
  detection_.near_tunnels.clear();
  for (int t = 0; t < static_cast<int>(scene.tunnels.size()); ++t)
    if (may_enter(tendon, t) && (overlap(box, detection_.bores[t].box, c.radius) || c.threads(t)))
      detection_.near_tunnels.push_back(t);
  thread(c);
  for (int i = 0; i < c.n(); ++i) {
    int& in = c.tunnel_of[i];
    if (in < 0 || (may_enter(tendon, in) && detection_.bores[in].beyond(c.x.at(i)) <= 0)) continue;
    in = -1;
  }
  for (const int t : detection_.near_tunnels) enter(c, t);
}

// Finds the segments that run through bores, before particles leave these.
void World::thread(Tendon& c) {
  std::vector<Threaded> now;
  for (const int t : detection_.near_tunnels) {
    const Bore& bore = detection_.bores[t];
    for (int k = 0; k + 1 < c.n(); ++k) {
      const Vec3 a = c.x.at(k), b = c.x.at(k + 1);
      if (bore.is_between(a, b) && (c.is_in_bore(k, t) || bore.is_threaded(a, b))) now.push_back({k, t});
    }
  }
  c.threaded.swap(now);
}

void World::enter(Tendon& c, int tunnel) {
  const Bore& bore = detection_.bores[tunnel];
  auto is_within = [&](int i) {
    return c.tunnel_of[i] == tunnel || (c.tunnel_of[i] < 0 && bore.contains(c.x.at(i), 0));
  };
  auto follows = [&](int i) {
    return c.tunnel_of[i] == tunnel || (c.tunnel_of[i] < 0 && bore.beyond(c.x.at(i)) <= 0);
  };
  for (int i = 0; i < c.n(); ++i) {
    if (!is_within(i)) continue;
    int first = i;
    bool any = c.tunnel_of[i] == tunnel;
    for (; i + 1 < c.n() && is_within(i + 1); ++i) any |= c.tunnel_of[i + 1] == tunnel;
    if (!any && !came_through_mouth(c, bore, first, i)) continue;
    while (first > 0 && follows(first - 1)) --first;
    while (i + 1 < c.n() && follows(i + 1)) ++i;
    std::fill(c.tunnel_of.begin() + first, c.tunnel_of.begin() + i + 1, tunnel);
  }
}

// A tunnel is skipped if the tendon is farther from the bore's box than both can move in the substep plus the
// longest segment: it then has no contacts (bore_contacts, mouth_reach).
void World::find_near_tunnels(int tendon) {
  const Tendon& c = *step_.slots[tendon];
  detection_.near_tunnels.clear();
  if (scene.tunnels.empty()) return;
  const Box box = box_of(c.x);
  double longest = 0;
  for (double l : c.rest) longest = std::max(longest, l);
  const double own = c.radius + options.contact_threshold + c.most_slack + most_motion(c) + longest;
  for (int t = 0; t < static_cast<int>(scene.tunnels.size()); ++t) {
    if (!may_enter(tendon, t)) continue;
    const Link& link = scene.links[scene.tunnels[t]->link];
    // Motion of the bore, which is linear in position: its bound over the tendon's box.
    const double carried = norm(link.drift(box.middle(), step_.context.dt)) +
                           step_.context.dt * norm(link.drift_rates.angular) * box.half_diagonal();
    ++step_.report.near.tunnels;
    if (overlap(box, detection_.bores[t].box, own + carried + scene.tunnels[t]->chamfer) || c.is_in_bore(t))
      detection_.near_tunnels.push_back(t);
    else
      ++step_.report.near.tunnels_culled;
  }
}

// Algorithm 2, step 2: |across(axis)(x - p)| <= R - r for particles that are, or are predicted to be, inside.
void World::bore_contacts(int tendon, int t) {
  const Tendon& c = *step_.slots[tendon];
  const Bore& bore = detection_.bores[t];
  const Link& link = scene.links[scene.tunnels[t]->link];
  const double kept = distance_kept_from_edge(c, t);
  BendsAtMouth mouths[2] = {{c, bore.rim(0), kept}, {c, bore.rim(1), kept}};
  for (int i = 0; i < c.n(); ++i) {
    const Vec3 x = c.x.at(i), ahead = c.predicted.at(i) - link.foreseen_at(x);
    const bool inside = c.tunnel_of[i] == t;
    // Before an oblique mouth, the wall reaches beyond the mouth's plane. A particle enters where it is
    // beside that wall, or before a mouth that it is predicted to pass.
    auto enters = [&] {
      return bore.beyond(x) > 0 && bore.off_axis(x) <= bore.radius &&
             (bore.contains(ahead, 0) || bore.has_wall(x, bore.along(x)));
    };
    if (!inside && !enters()) continue;
    // Where there is no wall, and within a chamfer, the mouth contact represents the bone.
    const double z = bore.along_within(x);
    if (!bore.has_wall(x, z)) continue;
    const Vec3 on_axis = bore.start + z * bore.axis;
    Contact contact;
    contact.key = {ContactKind::bore, tendon, i, t};
    contact.a = particle_of(c, tendon, i);
    const double room = std::max(0.0, bore.radius - c.radius - options.contact_threshold);
    const Rim wall = foreseen_rim(rim_of(on_axis, bore.axis, room, {}), link);
    contact.geometry.rim = contact.geometry.foreseen_rim = wall;
    contact.geometry.margin = options.contact_threshold;
    const Vec3 bend = bend_beside(c, i, mouths);
    std::fill_n(contact.geometry.foreseen_bend, 2, bend);
    contact.geometry.bulge = kBulgeAtEnd * bend;
    contact.geometry.normal = direction_across(on_axis - x - contact.geometry.bulge, bore.axis);
    add_link_contact(contact, scene.tunnels[t]->link, scene.tunnels[t]->friction);
  }
}

// Algorithm 2, step 3: contacts of segments near the circle of a mouth.
void World::mouth_contacts(int tendon, int t) {
  const Tendon& c = *step_.slots[tendon];
  const Bore& bore = detection_.bores[t];
  const double kept = distance_kept_from_edge(c, t);
  const double farthest = mouth_reach(tendon, t, 0, c.n() - 1) + most_bulge(c, 0, c.n() - 1);
  for (int mouth : {0, 1}) {
    const Rim rim = bore.rim(mouth);
    BendsAtMouth bends(c, rim, kept);
    auto is_beyond = [](double over, double other, double reach) {
      return over * other > 0 && std::min(std::fabs(over), std::fabs(other)) > reach;
    };
    double over = 0, other = rim.height(c.x.at(0));  // of both ends of the segment [m]
    for (int k = 0; k + 1 < c.n(); ++k) {
      over = other;
      other = rim.height(c.x.at(k + 1));
      if (is_beyond(over, other, farthest)) continue;
      const Vec3 a = c.x.at(k), b = c.x.at(k + 1), d = b - a;
      const bool threads = over * other < 0 && c.is_in_bore(k, t);
      SegmentAtMouth at{tendon, t, mouth, k, threads, mouth_reach(tendon, t, k, k + 1), {a, d, {}}};
      const double reach = at.reach + most_bulge(c, k, k + 1);
      if (is_beyond(over, other, reach)) continue;
      const double length2 = dot(d, d);
      const double u = length2 > 0 ? std::min(1.0, std::max(0.0, dot(rim.centre - a, d) / length2)) : 0;
      if (!threads && norm(a + u * d - rim.centre) > rim.longest + reach) continue;
      // Both ends are within the wall: the bore contacts are sufficient.
      auto inside = [&](Vec3 p, int i) { return c.tunnel_of[i] == t && bore.is_within_rims(p); };
      if (inside(a, k) && inside(b, k + 1)) continue;
      for (int end : {0, 1}) at.now.bend[end] = bends.at(k + end);
      edge_contacts(at, rim);
    }
  }
}

// Distance of the centreline of a tendon that lies on an edge of the tunnel's mouths from that edge [m].
double World::distance_kept_from_edge(const Tendon& c, int t) const {
  return c.radius + scene.tunnels[t]->chamfer + options.contact_threshold;
}

// Distance from an edge of the tunnel's mouths within which particles first ... last, and what is between
// them, can touch it in the substep [m].
double World::mouth_reach(int tendon, int t, int first, int last) const {
  const Link& link = scene.links[scene.tunnels[t]->link];
  double reach = 0;
  for (int i = first; i <= last; ++i)
    reach = std::max(reach, reach_of(*step_.slots[tendon], i, link, options.contact_threshold));
  return reach + scene.tunnels[t]->chamfer;
}

// Contacts of a segment with an edge, at the points that are predicted to be nearest at the end of the
// substep. The point that is nearest now would have slid past the edge by then, and the contact would push it
// further. In the narrow ends of an ellipse, a tendon can touch both sides.
void World::edge_contacts(const SegmentAtMouth& at, Rim rim) {
  const Tendon& c = *step_.slots[at.tendon];
  const Link& link = scene.links[scene.tunnels[at.tunnel]->link];
  const Vec3 a = c.predicted.at(at.segment) - link.foreseen_at(c.x.at(at.segment));
  const Vec3 b = c.predicted.at(at.segment + 1) - link.foreseen_at(c.x.at(at.segment + 1));
  const BentSegment ahead{a, b - a, {at.now.bend[0], at.now.bend[1]}};
  const double nearest = nearest_to_rim(ahead, rim), kept = distance_kept_from_edge(c, at.tunnel);
  if (rim.is_circle()) return mouth_contact(at, rim, nearest);
  end_halves(rim, kept + kRounded * std::max(0.0, rim.radius - kept), ahead.tangent(nearest));
  for (const int half : {1, -1}) {
    rim.half = half;
    mouth_contact(at, rim, nearest_to_rim(ahead, rim));
  }
}

void World::mouth_contact(const SegmentAtMouth& at, const Rim& rim, double u) {
  Tendon& c = *step_.slots[at.tendon];
  const Tunnel& tunnel = *scene.tunnels[at.tunnel];
  const Link& link = scene.links[tunnel.link];
  const int k = at.segment;
  if (u >= 1 && k + 2 < c.n()) return;  // the next segment has this point
  const Vec3 x = at.now.at(u);
  const Vec3 sideways = direction_across(x - rim.centre, rim.axis);
  const Vec3 apart = x - nearest_on_rim(rim, x).point;
  const double distance = norm(apart);
  const Vec3 a = c.x.at(k), b = c.x.at(k + 1);
  const bool beyond = at.threads && passes_beyond(rim, a, b);
  if (distance > at.reach && !beyond) return;
  const double motion = std::max(motion_of(c, k, link), motion_of(c, k + 1, link));
  limit_motion(c, safe_fraction(distance, c.radius + tunnel.chamfer, motion));
  Contact contact;
  contact.key = {ContactKind::mouth, at.tendon, k, 2 * at.tunnel + at.mouth, 0, rim.half};
  contact.a = {at.tendon, k, 1 - u, u};
  contact.geometry.rim = contact.geometry.foreseen_rim = foreseen_rim(rim, link);
  contact.geometry.margin = options.contact_threshold;
  contact.geometry.offset = distance_kept_from_edge(c, at.tunnel);
  std::copy_n(at.now.bend, 2, contact.geometry.bend);
  std::copy_n(at.now.bend, 2, contact.geometry.foreseen_bend);
  contact.geometry.bulge = at.now.bulge(u);
  contact.geometry.threads_mouth = at.threads;
  contact.geometry.beyond_edge = beyond;
  contact.geometry.normal = unit_or(apart, -sideways);
  add_link_contact(contact, tunnel.link, tunnel.friction);
}

}  // namespace bt
