// Algorithm 2: which stretch of a tendon is in which tunnel, and the rows of bores and mouths.
#include <algorithm>

#include "constants.h"
#include "world.h"

namespace bt {

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
