// Geodesics of quadrics about the origin: sum w_i x_i^2 = 1. An ellipsoid of semi-axes a_i has w_i = 1/a_i^2,
// a cylinder along z has w_z = 0.
//
// A geodesic turns in the plane of its direction t and the normal alone,
//
//   x'' = -(sum w t^2 / sum w^2 x^2) w x,      w x by components.
//
// With Gauss's curvature K = w_x w_y w_z / (sum w^2 x^2)^2, its neighbours are at distances J beside it with
// J'' + K J = 0: those that start beside it in parallel (J = 1, J' = 0), and those that start at an angle
// (J = 0, J' = 1). Butcher's Runge-Kutta method of order 6 integrates all of it.
//
// The shortest way from p to q around an ellipsoid is straight to P on the surface, a geodesic to Q, and
// straight again, without a kink at P and Q (Scholz et al. 2015). Where the geodesic starts, in which
// direction and how far it goes are four numbers, found by Newton's method. Where the start moves by ds along
// the geodesic and by du aside (b), turns by dv, and the geodesic gets longer by dl, its end moves by
//
//   (ds + dl) t + (J_1 du + J_2 dv) b,      and turns by      J_1' du + J_2' dv,
//
// with J_1 of the parallel neighbours and J_2 of those at an angle.
#pragma once
#include "math/rotation.h"

namespace bt {

struct Geodesic {
  Vec3 start, direction;  // direction: a unit vector in the surface
  double length = 0;      // 0: none
};

// Of a geodesic: its end, and the neighbours there.
struct GeodesicEnd {
  Vec3 point, direction;
  double beside, beside_slope;  // J of those that start in parallel
  double turned, turned_slope;  // J of those that start at an angle
};
GeodesicEnd end_of(const Geodesic& g, Vec3 weights);

// Improves a guess of the geodesic of the shortest way from p to q, points outside of an ellipsoid of these
// semi-axes. Returns the remaining sine of a kink at its ends.
double straighten(Geodesic& g, Vec3 radii, Vec3 p, Vec3 q);

}  // namespace bt
