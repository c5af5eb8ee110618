// Tendons whose held particles are nearer to each other than they are thick.
//
// No force moves what is held, or not from each other on one link: a contact there has no solution, and next
// to it one that bends both tendons as sharply as their segments let them. So from there on they part little
// by little. With d the distance of the held particles and s, t the arcs from them to the points that touch,
// what is kept apart is
//
//   min(r_a + r_b, d + kParting (s + t)).
#include <algorithm>
#include <numeric>

#include "collision/narrow_phase.h"
#include "constants.h"

namespace bt {

namespace {

bool stays(const Hold& h, const std::vector<Link>& links) {
  return h.link < 0 ? h.rigid : !links[h.link].yields();
}

// Rest length between two particles, in order; and from one to the point u of segment k.
double arc_between(const Chain& c, int first, int last) {
  return std::accumulate(c.rest.begin() + first, c.rest.begin() + last, 0.0);
}
double arc_to(const Chain& c, int particle, int k, double u) {
  return particle <= k ? arc_between(c, particle, k) + u * c.rest[k]
                       : (1 - u) * c.rest[k] + arc_between(c, k + 1, particle);
}

}  // namespace

double kept_apart(const SegmentPair& p, const Chain& a, const Chain& b, const std::vector<Link>& links) {
  double apart = a.radius + b.radius;
  for (const Hold& h : a.holds)
    for (const Hold& g : b.holds) {
      const bool together = h.link >= 0 && h.link == g.link;
      if (!together && !(stays(h, links) && stays(g, links))) continue;
      const double d = norm(h.aim - g.aim);
      if (d >= apart) continue;
      // Of one tendon, two holds side by side do not contradict a contact: what is between them is none.
      const auto [first, last] = std::minmax(h.particle, g.particle);
      if (&a == &b && arc_between(a, first, last) < kSelfContactArc * a.radius) continue;
      const double arcs = arc_to(a, h.particle, p.segment_a, p.u) + arc_to(b, g.particle, p.segment_b, p.w);
      apart = std::min(apart, d + kParting * arcs);
    }
  return apart;
}

}  // namespace bt
