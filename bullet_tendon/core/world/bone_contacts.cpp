// The contacts of a tendon with bones: with the nearest sides of their shapes, where these are foreseen to
// be.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/bent_segment.h"
#include "math/rounding.h"
#include "world/world.h"

namespace bt {

namespace {

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
  if (over.turns(from, to, c.radius)) return {};
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

Tangent in_world(const Tangent& surface, const Pose& pose) {
  return {to_world(pose, surface.point), pose.rotation * surface.normal, pose.rotation * surface.axis,
          surface.radius, surface.share};
}

}  // namespace

void World::bone_contacts(int tendon, int s) {
  const Tendon& c = *step_.slots[tendon];
  const Shape& shape = *scene.shapes[s];
  const Link& link = scene.links[shape.link];
  NearCache& cache = detection_.caches[tendon][s];
  std::vector<Entry>& entries = cache.entries;
  if (std::none_of(entries.begin(), entries.end(), [](const Entry& e) { return e.wanted; })) return;
  const Pose end = link.foreseen_pose(in_world(shape, link));
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
        segment ? SegmentPoint{tendon, f - n, 1 - e.now.u, e.now.u} : particle_point(tendon, f, n);
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
  const Pose pose = in_world(shape, link), end = link.foreseen_pose(pose);
  const Vec3 normal = pose.rotation * shape.plane_normal;
  const double offset = shape.plane_offset + dot(normal, pose.origin);
  for (int i = 0; i < c.n(); ++i) {
    Vec3 x = c.x.at(i);
    double height = dot(normal, x) - offset;
    if (height > reach_of(c, i, link, options.contact_threshold)) continue;
    const Vec3 foot = to_world(end, to_local(pose, x - height * normal));
    bone_contact(particle_point(tendon, i, c.n()), {ContactKind::bone, tendon, i, s},
                 {foot, end.rotation * shape.plane_normal});
  }
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

}  // namespace bt
