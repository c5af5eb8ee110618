// Contact of a segment with the edge of a tunnel mouth: a circle of radius R, centre c and axis e.
//
//   D(x) = sqrt((R - rho)^2 + z^2)         distance of a point from the circle [m]
//   H    = m m^T / D - kappa t t^T         second derivative of D [1/m]; t is the tangent of the circle,
//                                          m = t x n, kappa = (R - rho) / (D rho)
//   g(a, b) = min_u D(a + u l) - r         gap of the segment a-b [m], l = b - a
//   g''     = P^T H P - v v^T / (l.H l)    P = (1 - u, u), v = P^T H l + (-n, n)
//
// The contact point is the nearest point of every iteration. With a fixed point, a segment that slides or
// turns would leave the edge or penetrate it, and the normal force would turn the segment further.
#include <algorithm>
#include <cmath>

#include "contact/contact.h"
#include "geometry/segment_distance.h"
#include "geometry/tunnel_bore.h"

namespace bt {

void Contact::mouth_gap(Vec3 x, double& curvature, Vec3& around, double& across_edge) {
  Vec3 from = x - geometry.axis_point, radial = without(from, geometry.axis);
  double rho = norm(radial), z = dot(from, geometry.axis), inward = geometry.feature_radius - rho;
  Vec3 out = rho > 0 ? (1 / rho) * radial : any_perpendicular(geometry.axis);
  double d = std::sqrt(inward * inward + z * z);
  // A segment through the mouth that is beyond the circle is inside the bone. It is pushed back to the bore.
  double sign = geometry.threads_mouth && inward < 0 ? -1 : 1;
  geometry.gap = sign * d - geometry.offset;
  if (d > 0) {
    geometry.normal = (sign / d) * (z * geometry.axis - inward * out);
    across_edge = -sign / d;
  }
  if (d > 0 && rho > 0) curvature = sign * inward / (d * rho);
  around = cross(geometry.axis, out);
}

// The search for the point of a segment nearest to an edge starts at the last point.
void Contact::follow(Vec3 start, Vec3 end) {
  const Vec3 l = end - start;
  const double l2 = dot(l, l);
  if (l2 == 0) return;
  double u = a.w1;
  for (int i = 0; i < kAdvances; ++i) {
    const Vec3 on_edge = nearest_on_circle(start + u * l, geometry.axis_point, geometry.axis,
                                           geometry.feature_radius, any_perpendicular(geometry.axis));
    u = std::min(std::max(dot(on_edge - start, l) / l2, 0.0), 1.0);
  }
  a.w0 = 1 - u;
  a.w1 = u;
  geometry.point_shift = (u - friction.anchored_at) * l;
}

void Contact::add_sliding_term(Vec3 start, Vec3 end, bool definite) {
  geometry.sliding_terms = 0;
  const double u = a.w1;
  if (key.kind != ContactKind::mouth || !normal_force.pressed || u <= 0 || u >= 1) return;
  const Vec3 x = (1 - u) * start + u * end, l = end - start;
  const double kept = geometry.gap;
  double curvature = 0, across_edge = 0;
  Vec3 around;
  mouth_gap(x, curvature, around, across_edge);
  geometry.gap = kept;
  const Vec3 m = cross(around, geometry.normal);
  const Vec3 Hl = (-across_edge * dot(m, l)) * m - (curvature * dot(around, l)) * around;
  const double bent = dot(l, Hl);
  if (bent == 0 || (definite && bent < 0)) return;
  geometry.sliding_terms = 1;
  geometry.sliding_share[0] = normal_force.lambda_predicted / bent;
  geometry.sliding_term[0][0] = (1 - u) * Hl - geometry.normal;
  geometry.sliding_term[0][1] = u * Hl + geometry.normal;
}

}  // namespace bt
