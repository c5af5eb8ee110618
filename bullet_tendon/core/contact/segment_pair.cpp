// Contact of two segments of tendons. Both can slide and turn.
//
//   D      = n.d, d = a(u) - b(w)          distance of the nearest points [m], n = d / |d|; once the segments
//                                          have crossed, D < 0 and n = -d / |d|
//   H      = (I - n n^T) / D               second derivative of |d| [1/m]
//   g      = min_u,w D - (r_a + r_b)       gap [m]
//   g''    = P^T H P - V S^-1 V^T          P = (1 - u, u, -(1 - w), -w)
//   V      = (P^T H l_a + (-n, n, 0, 0), -P^T H l_b + (0, 0, n, -n)),  l the segments
//   S      = (l_a.H l_a, -l_a.H l_b; ., l_b.H l_b)
//
// The contact points are the nearest points of every iteration, for the same reason as at an edge
// (contact/following.cpp). A point at the end of its segment is fixed and has no column in V. Nearly
// parallel segments have no unique nearest points. They have a contact with fixed points at each end of the
// stretch along which they touch (geometry/segment_distance.h).
#include <cmath>

#include "contact/contact.h"
#include "geometry/segment_distance.h"

namespace bt {

namespace {

// Square of the sine between two segments up to which the term of the point that slides along the second one
// is left out [-]. Smaller: that of parallel segments is rounding, and stiffer than the tendon by so much
// that the matrix is not definite. Larger: tendons that cross take more iterations.
constexpr double kLeastSquaredSine = 1e-6;

bool is_inside(double u, double w) { return u > 0 && u < 1 && w > 0 && w < 1; }

}  // namespace

void Contact::begin_pair(Vec3 along, Vec3 other) {
  geometry.side = geometry.normal;
  friction.along_start = along;
  friction.other_start = other;
  const bool inside = is_inside(friction.anchored_at, friction.anchored_at_other);
  geometry.handedness = inside ? std::copysign(1.0, dot(geometry.side, cross(along, other))) : 0;
}

void Contact::follow_pair(const Vec3 (&x)[4]) {
  geometry.follows = false;
  if (geometry.parallel) return;
  const Vec3 along = x[1] - x[0], other = x[3] - x[2];
  const auto [u, w] = nearest_parameters(x[0], x[1], x[2], x[3]);
  const Vec3 apart = x[0] + u * along - (x[2] + w * other);
  // Where the points nearly meet on the straight way since the start of the step, the segments may have
  // crossed. Their common perpendicular tells whether they have. Points at ends have none: there the normal
  // of the start defines the side.
  const double least = segment_distance(friction.relative_start, apart, {}, {});
  const bool may_have_crossed = least <= kNearlyMet * geometry.offset;
  const bool inside = geometry.handedness != 0 && is_inside(u, w);
  if (may_have_crossed && !inside) {
    geometry.normal = geometry.side;
    return;
  }
  geometry.follows = true;
  a.w0 = 1 - u;
  a.w1 = u;
  b.w0 = 1 - w;
  b.w1 = w;
  geometry.point_shift = (u - friction.anchored_at) * friction.along_start -
                         (w - friction.anchored_at_other) * friction.other_start;
  geometry.normal = may_have_crossed ? unit_or(geometry.handedness * cross(along, other), geometry.side)
                                     : (1 / norm(apart)) * apart;
}

void Contact::add_pair_sliding_terms(const Vec3 (&x)[4], bool definite) {
  geometry.sliding_terms = 0;
  if (!geometry.follows || !normal_force.pressed || normal_force.lambda_predicted <= 0) return;
  const double D = geometry.gap + geometry.depth_allowance + geometry.offset;
  if (D < kNearlyMet * geometry.offset) return;  // the terms grow with 1 / D, and nearly cancel
  if (!definite) force.block += (-normal_force.lambda_predicted / D) * across(geometry.normal);
  const Vec3 along = x[1] - x[0], other = x[3] - x[2];
  const bool inside_a = a.w0 > 0 && a.w1 > 0, inside_b = b.w0 > 0 && b.w1 > 0;
  const double P[4] = {a.w0, a.w1, -b.w0, -b.w1};
  const Vec3 Ha = (1 / D) * without(along, geometry.normal), Hb = (1 / D) * without(other, geometry.normal);
  Vec3 va[4], vb[4];
  for (int i = 0; i < 4; ++i) {
    va[i] = P[i] * Ha;
    vb[i] = -P[i] * Hb;
  }
  va[0] += -1.0 * geometry.normal;
  va[1] += geometry.normal;
  vb[2] += geometry.normal;
  vb[3] += -1.0 * geometry.normal;
  const double aa = dot(along, Ha), ab = -dot(along, Hb), bb = dot(other, Hb);
  auto take = [&](const Vec3(&v)[4], double share) {
    for (int i = 0; i < 4; ++i) geometry.sliding_term[geometry.sliding_terms][i] = v[i];
    geometry.sliding_share[geometry.sliding_terms++] = normal_force.lambda_predicted * share;
  };
  if (inside_a) take(va, 1 / aa);
  if (!inside_b) return;
  const double mixed = inside_a ? ab / aa : 0,
               rest = bb - mixed * ab;  // elimination in S, as by its Cholesky factors
  for (int i = 0; i < 4; ++i) vb[i] += -mixed * va[i];
  if (rest > kLeastSquaredSine * bb) take(vb, 1 / rest);
}

}  // namespace bt
