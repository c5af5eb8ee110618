// Contacts of a segment whose point slides along it: with the edge of a tunnel mouth (Rim), and with a round
// surface.
//
//   D(x) = |x - nearest point of the edge| [m], n its gradient
//   H    = m m^T / D - kappa t t^T         second derivative of D [1/m]; t is the tangent of the edge,
//                                          m = t x n, kappa = n.k / (1 - D n.k), k its curvature vector
//   D(x) = distance from the axis of a cylinder, H = t t^T / D; from the centre of a sphere,
//          H = (1 - n n^T) / D
//   g(a, b) = min_u D(a + u l) - r         gap of the segment a-b [m], l = b - a
//   g''     = P^T H P - v v^T / (l.H l)    P = (1 - u, u), v = P^T H l + (-n, n)
//
// The contact point is the nearest point of every iteration. With a fixed point, a segment that slides or
// turns would leave the edge or penetrate it, and the normal force would turn the segment further: the chords
// around a wheel would turn to and fro, each against its neighbours. Friction resists the displacement in the
// step of what is now the contact point, at which it acts. With the displacement of the point that touched
// first, the derivative of a sticking friction would not be symmetric, and far from the block where segments
// roll onto a surface.
#include <algorithm>
#include <cmath>

#include "contact/contact.h"
#include "geometry/tunnel_bore.h"

namespace bt {

namespace {

BentSegment bent(const ContactGeometry& geometry, Vec3 start, Vec3 end) {
  return {start, end - start, {geometry.bend[0], geometry.bend[1]}};
}

}  // namespace

void Contact::mouth_gap(Vec3 x) {
  const Rim& rim = geometry.rim;
  geometry.edge = nearest_on_rim(rim, x, geometry.edge);
  const RimPoint& edge = geometry.edge;
  const Vec3 from = x - edge.point;
  const double d = norm(from), bend = dot(from, edge.curvature);
  const double sign = geometry.beyond_edge ? -1 : 1;  // a segment within the bone is pushed back to the bore
  geometry.gap = sign * d - geometry.offset;
  if (d > 0) {
    geometry.normal = (sign / d) * from;
    curvature.across = -sign / d;
    if (bend < 1) curvature.along = sign * bend / (d * (1 - bend));
  }
  curvature.direction = edge.tangent;
}

void Contact::turn(const Rot3& by) {
  geometry.rim = turned(geometry.foreseen_rim, by);
  for (int end : {0, 1}) geometry.bend[end] = by * geometry.foreseen_bend[end];
  geometry.bulge = bent(geometry, {}, {}).bulge(a.w1);
}

void Contact::slide_to(double u) {
  a.w1 = std::min(std::max(u, geometry.slides.from), geometry.slides.to);
  a.w0 = 1 - a.w1;
}

void Contact::follow(Vec3 start, Vec3 end) {
  if (is_round()) {
    const Vec3 l = without(end - start, geometry.rim.axis);
    const double square = dot(l, l);
    if (square > 0) slide_to(dot(geometry.rim.centre - start, l) / square);
  } else {
    const BentSegment segment = bent(geometry, start, end);
    slide_to(slide_to_rim(segment, a.w1, geometry.rim, geometry.edge));
    geometry.bulge = segment.bulge(a.w1);
    geometry.beyond_edge = geometry.threads_mouth && passes_beyond(geometry.rim, start, end);
  }
  geometry.point_shift = (a.w1 - friction.anchored_at) * friction.along_start;
}

void Contact::add_sliding_term(Vec3 start, Vec3 end, bool definite) {
  geometry.sliding_terms = 0;
  const double u = a.w1;
  if (!follows() || !normal_force.pressed || u <= geometry.slides.from || u >= geometry.slides.to) return;
  const BentSegment segment = bent(geometry, start, end);
  const Vec3 l = segment.tangent(u);
  const Vec3 around = curvature.direction, m = cross(around, geometry.normal);
  const Vec3 Hl = (-curvature.across * dot(m, l)) * m - (curvature.along * dot(around, l)) * around;
  const double convexity = dot(l, Hl) + dot(geometry.normal, segment.bend_at(u));
  if (convexity == 0 || (definite && convexity < 0)) return;
  geometry.sliding_terms = 1;
  geometry.sliding_share[0] = normal_force.lambda_predicted / convexity;
  geometry.sliding_term[0][0] = (1 - u) * Hl - geometry.normal;
  geometry.sliding_term[0][1] = u * Hl + geometry.normal;
}

}  // namespace bt
