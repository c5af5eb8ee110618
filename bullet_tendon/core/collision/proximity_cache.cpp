#include "collision/proximity_cache.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "math/rounding.h"

namespace bt {

namespace {

// Motion of a feature, as a share of its distance, for which its list of triangles is complete [-]. Larger:
// lists cost more. Smaller: more searches.
constexpr double kListed = 0.05;

// Least depth of the particles of an insertion in a mesh, in radii [-]. Larger: those above are pushed to
// both sides. Smaller: rounding decides whether an attachment on the surface is an insertion.
constexpr double kBuried = 1e-3;

}  // namespace

void Queries::clear() {
  by_oracle.clear();
  from_ends.clear();
}

Pose in_world(const Shape& shape, const Link& link) {
  return {link.pose.rotation * shape.local.rotation, to_world(link.pose, shape.local.origin)};
}

double safe_fraction(double clearance, double radius, double motion) {
  if (motion <= kFarthestMove * radius || clearance - motion > radius) return 1;
  return std::max(clearance - radius, kFarthestMove * radius) / motion;
}

double motion_limit_of(const NearCache& cache, const Shape& shape, const Tendon& tendon) {
  const int n = static_cast<int>(cache.local.size());
  auto face_over = [&](int i) {
    const Vec3 here = cache.local[i];
    return shape.primitive.face_over(here, here + cache.way[i], tendon.slack[i]);
  };
  auto ends_clear = [&](const Entry& e, int i) {
    const double height = e.clearance + dot(e.now.normal, cache.way[i]);
    return shape.primitive && height > tendon.radius + tendon.slack[i];
  };
  double room = 1;
  for (int f = 0; f < static_cast<int>(cache.entries.size()); ++f) {
    const Entry& e = cache.entries[f];
    if (!e.wanted) continue;
    const int a = f < n ? f : f - n, b = f < n ? f : a + 1;
    const double motion = std::max(norm(cache.way[a]), norm(cache.way[b]));
    const double safe = safe_fraction(e.clearance, tendon.radius, motion);
    if (safe >= room || (ends_clear(e, a) && ends_clear(e, b))) continue;
    const int face = face_over(a);
    if (face == 0 || face != face_over(b)) room = safe;
  }
  return room;
}

namespace {

Vec3 way_of(const Tendon& tendon, int i, const Link& link) {
  return tendon.predicted.at(i) - tendon.x.at(i) - link.foreseen_at(tendon.x.at(i));
}

}  // namespace

double motion_of(const Tendon& tendon, int i, const Link& link) { return norm(way_of(tendon, i, link)); }

double reach_of(const Tendon& tendon, int i, const Link& link, double threshold) {
  return tendon.radius + threshold + tendon.slack[i] + motion_of(tendon, i, link);
}

BT_VECTOR Box box_of_reach(const Tendon& tendon, double threshold) {
  Box box;
  double square = 0;
  for (int i = 0; i < tendon.n(); ++i) {
    const Vec3 x = tendon.x.at(i), moved = tendon.predicted.at(i) - x;
    box.include(x);
    square = std::max(square, dot(moved, moved));
  }
  box.grow(tendon.radius + threshold + tendon.most_slack + std::sqrt(square));
  return box;
}

namespace {

// Whether a shape stays out of reach of a tendon in the substep, by boxes along the axes of the world.
bool is_out_of_reach(const Shape& shape, const Pose& pose, const Link& link, const Box& reach) {
  const Vec3 middle = to_world(pose, shape.box().middle()), half = 0.5 * (shape.hi - shape.lo);
  const auto half_along = [&](Vec3 row) {
    return std::fabs(row.x) * half.x + std::fabs(row.y) * half.y + std::fabs(row.z) * half.z;
  };
  const Rot3& turn = pose.rotation;
  const Vec3 extent{half_along(turn.r0), half_along(turn.r1), half_along(turn.r2)};
  const double carried =
      norm(link.foreseen_at(reach.middle())) + norm(link.foreseen.all.angular) * reach.half_diagonal();
  return !overlap({middle - extent, middle + extent}, reach, carried);
}

// Whether bone at a point (world) is drilled away [m].
bool in_any_bore(Vec3 p, const std::vector<Bore>& bores) {
  return std::any_of(bores.begin(), bores.end(), [&](const Bore& b) { return b.removes(p); });
}

// Where a particle is that bores remove bone around: before a mouth, or between both.
enum class Bored { no, ahead, within };

// Whether a bore removes the bone around a particle. A particle that belongs to it may be in its wall, as
// where a coarse tendon bends there: bone beside the wall would press it out, against the wall.
bool removes(const Bore& bore, const Tendon& tendon, int i) {
  return tendon.tunnel_of[i] == bore.tunnel || bore.removes(tendon.x.at(i));
}

Bored bored_at(const Tendon& tendon, int i, const std::vector<Bore>& bores) {
  Bored found = Bored::no;
  for (const Bore& b : bores)
    if (removes(b, tendon, i))
      found = std::max(found, b.beyond(tendon.x.at(i)) > 0 ? Bored::ahead : Bored::within);
  return found;
}

// The same of a segment, by those of its ends. One that leads from before a mouth to where bone is can touch
// that anywhere, such as a corner of the bone.
Bored bored_between(const Tendon& tendon, int segment, Bored one, Bored other,
                    const std::vector<Bore>& bores) {
  const auto threads = [&](const Bore& bore) { return tendon.threads(segment, bore.tunnel); };
  const bool within = one == Bored::within || other == Bored::within;
  return within || std::any_of(bores.begin(), bores.end(), threads) ? Bored::within : std::min(one, other);
}

// Whether bone pressed on a feature in the last step. It goes on to press before a mouth, until it lets go.
// Where a tendon is drawn against bone beside a mouth and pushed into what the bore removes, it would be let
// go there and drawn out again, and no place of it were at rest.
bool is_pressed(const NearContext& context, int feature) {
  return context.pressed && std::binary_search(context.pressed->begin(), context.pressed->end(), feature);
}

// Of a mesh, which has no points in holes.
Plane plane_of(const Nearest& found, const Query& q, Vec3 fallback) {
  const Vec3 nearest = (1 - found.u) * q.a + found.u * q.b;
  return {found.point, unit_or(nearest - found.point, fallback), q.of.whole(found.u), false};
}

// A feature that crosses the surface of a mesh keeps its last valid plane.
void cross_surface(Entry& e) {
  e.inside = true;
  e.clearance = 0;
  e.now = e.asked;
  e.wanted = e.known && !e.asked.hole;
}

// Features beyond their reach make no contact, even if they were measured.
bool is_within_reach(const Entry& e) { return !e.now.hole && e.clearance <= e.reach; }

// Takes the plane at this distance [m] that was found for the feature of a query.
void take_plane(Entry& e, const Query& q, const Plane& found, double distance) {
  e.known = true;
  e.inside = distance < 0;
  e.a = q.a;
  e.b = q.b;
  e.distance = distance;
  e.clearance = std::max(0.0, distance);
  e.asked = e.now = found;
  e.wanted = is_within_reach(e);
}

// Takes the nearest point that a search of the mesh has found.
void take_nearest(Entry& e, const Query& q, const Nearest& found) {
  e.nearby.clear();  // it is not complete up to e.listed
  if (found.distance == 0) return cross_surface(e);
  e.listed = (1 + 2 * kListed) * found.distance;
  take_plane(e, q, plane_of(found, q, e.asked.normal), found.distance);
}

// Upper bound of a distance to a mesh: that to one of its points, in spite of rounding.
double bound_of(Vec3 from, Vec3 point) { return (1 + kRoundingShare) * norm(from - point); }

// Decides for one feature between skipping, reusing, searching and querying.
struct Considering {
  const Tendon& tendon;
  const std::vector<Departure>& departures;
  const Shape& shape;
  const Link& link;
  const Pose pose;
  const NearContext& context;
  Queries& queries;
  NearCounts& counts;

  void operator()(Entry& e, const Query& query, double reach) {
    ++counts.considered;
    e.reach = reach;
    const bool reusable = e.known && !e.inside && context.reuse_tolerance > 0;
    const double moved = reusable ? std::max(norm(query.a - e.a), norm(query.b - e.b)) : HUGE_VAL;
    if (reusable) {
      if (e.distance - moved > reach) {
        ++counts.skipped;
        return;
      }
      if (context.surface ? remeasured(e, query, moved) : link.rests() && still_true(e, query, moved)) {
        ++counts.reused;
        e.wanted = is_within_reach(e);
        return;
      }
    }
    if (context.surface && (is_drilled() || (reusable && stays_outside(e, query, moved)))) {
      const Nearest found = search(e, query, reusable);
      if (found.distance > 0 || is_drilled()) {
        ++counts.searched;
        return take_nearest(e, query, found);
      }
    }
    ++counts.queried;
    if (context.surface && !e.known && query.feature >= tendon.n()) return queries.from_ends.push_back(query);
    if (!shape.primitive) return queries.by_oracle.push_back(query);
    const Primitive::Nearest found = nearest(query);
    answer(query, found.distance, found.point, found.u, pose, context, e);
  }

 private:
  bool remeasured(Entry& e, const Query& q, double moved) const {
    if (moved == 0) {
      e.now = e.asked;
      e.clearance = e.distance;
      return true;
    }
    if (moved > 0.5 * (e.listed - e.distance)) return false;
    if (e.nearby.empty()) context.surface->list(e.a, e.b, e.listed, e.nearby);
    const Nearest found = context.surface->nearest(e.nearby, q.a, q.b);
    e.now = plane_of(found, q, e.asked.normal);
    e.clearance = found.distance;
    return true;
  }

  // Whether the mesh is what its bores leave of it, which the oracle does not know.
  bool is_drilled() const { return context.surface != shape.surface.get(); }

  // Whether the ends have moved by less than their distance from the surface, or have not crossed it.
  bool stays_outside(const Entry& e, const Query& q, double moved) const {
    const Surface& surface = *context.surface;
    return moved < e.distance || !(surface.is_between(e.a, q.a) || surface.is_between(e.b, q.b));
  }

  Nearest search(const Entry& e, const Query& q, bool bounded) const {
    if (!bounded) return context.surface->search(q.a, q.b, HUGE_VAL);
    const double u = q.of.part(e.asked.u);
    const Vec3 last = (1 - u) * q.a + u * q.b;
    return context.surface->search(q.a, q.b, bound_of(last, e.asked.point));
  }

  // Distance that a segment keeps from the shape at a point, where the tendon departs from the shape [m].
  double kept(const Query& q, double u) const {
    double least = HUGE_VAL;
    for (const Departure& from : departures)
      least = std::min(least, contact_distance(tendon, q.feature - tendon.n(), q.of.whole(u), from));
    return least;
  }

  // Whether a segment keeps less distance at one end, near an attachment. Over an edge, that end may be
  // nearer than the point that lacks most of what it keeps.
  bool rises(const Query& q) const {
    return q.feature >= tendon.n() && !departures.empty() && kept(q, 0) != kept(q, 1);
  }

  // Of a primitive. Over a round surface the contact point follows as the nearest.
  Primitive::Nearest nearest(const Query& q) const {
    auto at = [&](double u) { return (1 - u) * q.a + u * q.b; };
    const Primitive::Nearest nearest = shape.primitive.nearest(q.a, q.b);
    const Vec3 out = unit_or(at(nearest.u) - nearest.point, {});
    if (!rises(q) || shape.primitive.round_at(nearest.point, out).radius > 0) return nearest;
    auto lacks = [&](double u) { return shape.primitive.nearest(at(u), at(u)).distance - kept(q, u); };
    double most = golden_section(0, 1, lacks);
    for (const double end : {0.0, 1.0})
      if (lacks(end) < lacks(most)) most = end;
    const Primitive::Nearest found = shape.primitive.nearest(at(most), at(most));
    return {found.distance, found.point, most};
  }

  bool still_true(Entry& e, const Query& q, double moved) const {
    const Vec3 n = e.asked.normal;
    const double aside = std::max(norm(without(q.a - e.a, n)), norm(without(q.b - e.b, n)));
    if (aside * aside > 2 * (e.distance - moved) * context.reuse_tolerance) return false;
    const double turned = std::fabs(dot(n, q.a - e.a) - dot(n, q.b - e.b));
    if (turned > context.reuse_tolerance && rises(q)) return false;
    e.now = e.asked;
    e.clearance = e.distance - moved;
    return true;
  }
};

// Inside of a mesh, insertions make no contact anyway.
void find_departures(const Tendon& tendon, const Shape& shape, const std::vector<Link>& links,
                     NearCache& cache) {
  cache.departures.clear();
  for (const Anchor& h : tendon.anchors) {
    if (!h.is_fixed() || !keep_distance(h, shape.link, links)) continue;
    const Vec3 at = cache.local[h.particle];
    cache.departures.push_back({h.particle});
    if (shape.primitive && h.link == shape.link)
      cache.departures.back().distance = shape.primitive.nearest(at, at).distance;
  }
}

}  // namespace

void ask(const Tendon& tendon, int tendon_slot, const Shape& shape, int shape_slot,
         const NearContext& context, NearCache& cache, Queries& queries, NearCounts& counts) {
  const int n = tendon.n();
  const Link& link = (*context.links)[shape.link];
  const Pose pose = in_world(shape, link);
  for (Entry& e : cache.entries) e.wanted = false;
  if (is_out_of_reach(shape, pose, link, context.reach)) {
    counts.culled += 2 * n - 1;
    return;
  }
  // Copied into the cache only where the shape is near. Most shapes are not.
  thread_local std::vector<Vec3> local;
  thread_local std::vector<Vec3> way;
  local.resize(n);
  way.resize(n);
  Box box;
  double reach = 0;
  for (int i = 0; i < n; ++i) {
    local[i] = to_local(pose, tendon.x.at(i));
    box.include(local[i]);
    way[i] = transposed_times(pose.rotation, way_of(tendon, i, link));
    reach = std::max(reach, norm(way[i]) + tendon.slack[i]);
  }
  const double skin = tendon.radius + context.threshold;
  reach += skin;
  if (!overlap(box, shape.box(), reach)) {
    counts.culled += 2 * n - 1;
    return;
  }
  if (cache.entries.size() != static_cast<size_t>(2 * n - 1)) cache.entries.assign(2 * n - 1, Entry{});
  cache.local = local;
  cache.way = way;
  find_departures(tendon, shape, *context.links, cache);
  Considering consider{tendon, cache.departures, shape, link, pose, context, queries, counts};
  // In a bore its wall is felt, and before a mouth the edge of that.
  auto is_spared = [&](int feature, Bored bored) {
    return bored == Bored::within || (bored == Bored::ahead && !is_pressed(context, feature));
  };
  double before = 0;  // reach of the previous particle [m]
  Bored bored_before = Bored::no;
  for (int i = 0; i < n; ++i) {
    const Vec3 here = cache.local[i];
    const double now = skin + norm(cache.way[i]) + tendon.slack[i];
    const Bored bored = bored_at(tendon, i, *context.bores);
    if (!overlap({here, here}, shape.box(), now) || is_spared(i, bored))
      ++counts.culled;
    else
      consider(cache.entries[i], {tendon_slot, shape_slot, i, here, here}, now);
    if (i > 0) {
      const Vec3 last = cache.local[i - 1];
      const double most = std::max(now, before);
      if (!overlap({lowest(last, here), highest(last, here)}, shape.box(), most) ||
          is_spared(n + i - 1, bored_between(tendon, i - 1, bored_before, bored, *context.bores)))
        ++counts.culled;
      else {
        const Stretch of = touching_part(tendon, i - 1, cache.departures);
        const Vec3 along = here - last;
        if (of.from < of.to)
          consider(cache.entries[n + i - 1],
                   {tendon_slot, shape_slot, n + i - 1, last + of.from * along, last + of.to * along, of},
                   most);
      }
    }
    before = now;
    bored_before = bored;
  }
}

void answer(const Query& q, double distance, Vec3 point, double u, const Pose& pose,
            const NearContext& context, Entry& e) {
  const Vec3 nearest = (1 - u) * q.a + u * q.b;
  const double length = norm(nearest - point);
  // A negative distance is valid if its point is at that distance: the penetration depth of a primitive. A
  // mesh gives no such point, and the last valid plane is kept.
  bool believed = distance > 0 || (distance < 0 && std::fabs(length + distance) < 1e-6 && length > 1e-9);
  if (!believed) return cross_surface(e);
  const double sign = distance < 0 ? -1 : 1;
  Plane plane{point, unit_or(sign * (nearest - point), e.asked.normal), q.of.whole(u),
              !context.surface && in_any_bore(to_world(pose, point), *context.bores)};
  if (context.surface && distance > 0) {
    e.listed = context.surface->list(q.a, q.b, (1 + 2 * kListed) * distance, e.nearby);
    const Nearest found = context.surface->nearest(e.nearby, q.a, q.b);
    distance = found.distance;
    plane = plane_of(found, q, plane.normal);
  }
  take_plane(e, q, plane, distance);
}

void measure_from_ends(const Query& q, const Surface& surface, NearCache& cache) {
  const int particles = static_cast<int>(cache.local.size());
  const Entry &start = cache.entries[q.feature - particles], &end = cache.entries[q.feature - particles + 1];
  double within = HUGE_VAL;
  if (start.known) within = bound_of(q.a, start.asked.point);
  if (end.known) within = std::min(within, bound_of(q.b, end.asked.point));
  take_nearest(cache.entries[q.feature], q, surface.search(q.a, q.b, within));
}

void leave_out_insertions(const Tendon& tendon, const Shape& shape, const std::vector<Bore>& bores,
                          NearCache& cache) {
  cache.buried.clear();
  if (cache.entries.empty()) return;
  const int n = tendon.n();
  auto is_buried = [&](int i) {
    const Vec3 x = cache.local[i];
    Side& side = cache.sides[i];
    if (norm(x - side.at) >= std::fabs(side.distance)) side = {x, (*shape.solid)(x)};
    const auto removes_there = [&](const Bore& bore) { return removes(bore, tendon, i); };
    return side.distance < 0 && std::none_of(bores.begin(), bores.end(), removes_there);
  };
  for (const Anchor& h : tendon.anchors) {
    if (h.link != shape.link || h.is_line) continue;
    if (cache.entries[h.particle].clearance <= kBuried * tendon.radius) continue;
    cache.sides.resize(n);
    if (!is_buried(h.particle)) continue;
    cache.buried.resize(n, 0);
    cache.buried[h.particle] = 1;
    for (const int next : {-1, 1})
      for (int i = h.particle + next; i >= 0 && i < n && !cache.buried[i] && is_buried(i); i += next)
        cache.buried[i] = 1;
  }
  for (int i = 0; i < static_cast<int>(cache.buried.size()); ++i) {
    if (!cache.buried[i]) continue;
    cache.entries[i].wanted = false;
    if (i > 0) cache.entries[n + i - 1].wanted = false;
    if (i < n - 1) cache.entries[n + i].wanted = false;
  }
}

void list_within_reach(Entry& e, Vec3 a, Vec3 b, const Surface& surface) {
  const double within = e.reach + std::max(norm(a - e.a), norm(b - e.b));
  if (!e.nearby.empty() && e.listed >= within) return;
  // A little more, so that the list holds for some steps.
  e.listed = surface.list(e.a, e.b, std::max(e.listed, (1 + kListed) * within), e.nearby);
}

namespace {

// Planes of a curved surface, tangent at the predicted position of a feature at the end of the step.
//
// A plane that is tangent at the present position is tilted by the angle (motion in the step) / R at the end
// of the step. Its normal force then acts like friction with that coefficient. The curvature along the tendon
// follows from the planes of the neighbouring features, without further queries.

// Whether the planes at both points can belong to one smooth part of the surface.
bool usable(const Entry& e, Vec3 from, double farthest) {
  const double away = norm(e.now.point - from);
  return e.wanted && away > 1e-3 * farthest && away <= farthest;
}

// The smaller of two curvatures, or zero if their signs differ [1/m]. Beside an edge, this is the curvature
// on the feature's side of it.
double flatter(double a, double b) { return a * b <= 0 ? 0 : std::fabs(a) < std::fabs(b) ? a : b; }

}  // namespace

Tangent tangent_of(const NearCache& cache, const Shape& shape, int feature, Vec3 ahead) {
  const int n = static_cast<int>(cache.local.size());
  const int first = feature < n ? 0 : n, last = feature < n ? n - 1 : 2 * n - 2;
  const double spacing =
      norm(cache.local[std::min(feature % n + 1, n - 1)] - cache.local[std::max(feature % n - 1, 0)]);
  const Vec3 point = cache.entries[feature].now.point, normal = cache.entries[feature].now.normal;
  const bool beside_box = feature < n && shape.primitive.is_flat();
  if (beside_box && shape.primitive.face_over(cache.local[feature], ahead, 0) == 0) {
    const Primitive::Nearest found = shape.primitive.nearest(ahead, ahead);
    if (found.distance > 0) return {found.point, (1 / found.distance) * (ahead - found.point)};
  }
  if (feature >= n && shape.primitive.is_round()) {
    const Vec3 a = cache.local[feature - n], b = cache.local[feature - n + 1];
    const Primitive::Round round = shape.primitive.round_at(point, normal);
    if (round.radius > 0)
      return {point, normal, round.axis, round.radius, shape.primitive.beside_straight(point, a, b)};
  }
  double curvature = 0, nearest = spacing;
  Vec3 along;
  bool found = false;
  for (int other : {feature - 1, feature + 1}) {
    if (other < first || other > last || !usable(cache.entries[other], point, spacing)) continue;
    const Entry& e = cache.entries[other];
    const Vec3 away = without(e.now.point - point, normal);
    const double length = norm(away);
    if (length <= 1e-3 * spacing) continue;
    const Vec3 t = (1 / length) * away;
    const double bent = dot(e.now.normal - normal, t) / length;
    curvature = found ? flatter(curvature, bent) : bent;
    if (!found) along = t;
    nearest = std::min(nearest, length);
    found = true;
  }
  const double aside = dot(ahead - point, along), height = dot(ahead - point, normal);
  if (curvature == 0 || 1 + curvature * height <= 0.5) return {point, normal};
  const double most = std::fabs(curvature) * nearest;
  const double angle = std::min(std::max(std::atan2(curvature * aside, 1 + curvature * height), -most), most);
  const double s = std::sin(angle), c = std::cos(angle);
  return {point + (s / curvature) * along + (-(1 - c) / curvature) * normal, c * normal + s * along};
}

}  // namespace bt
