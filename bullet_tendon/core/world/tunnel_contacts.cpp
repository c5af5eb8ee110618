// The tunnels in which particles are, and the contacts with their bores and mouths (algorithm 2).
#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/bent_segment.h"
#include "world/world.h"

namespace bt {

namespace {

// Largest bend of a segment, over that with which all of it is equally near to the edge of a mouth, so that
// it has no nearest point [-]. Smaller: a coarse tendon is felt to turn at its particles.
constexpr double kBend = 0.5;

// Distance over that at which a tendon lies on an elliptic edge, up to which the edge keeps its shape where
// the tendon touches both halves, over the tendon's clearance in the bore [-]. Smaller: where the tendon is
// hardly wider than the narrow end, the surface on which its centreline lies bends too sharply for Newton's
// method. Larger: the tendon is wedged where it only begins to touch both halves.
constexpr double kRounded = 0.05;

Rim foreseen_rim(const Rim& rim, const Link& link) {
  const Vec3 axis = unit_or(link.foreseen.turn * rim.axis, rim.axis);
  const Vec3 slope = without(link.foreseen.turn * rim.slope, axis);
  Rim foreseen = rim_of(link.foreseen_point(rim.centre), axis, rim.radius, slope);
  foreseen.half = rim.half;
  foreseen.end_c = rim.end_c;
  foreseen.end_s = rim.end_s;
  return foreseen;
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
  const double own = c.radius + options.contact_threshold + c.most_slack + c.most_motion() + longest;
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
    contact.a = particle_point(tendon, i, c.n());
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
