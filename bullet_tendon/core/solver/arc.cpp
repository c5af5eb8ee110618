// The second-order correction of a Newton step.
//
// A linear solution moves particles along straight lines. Therefore a segment of length l that rotates by
// the angle phi becomes l phi^2/2 too long. In a stiff tendon this is nearly all of the next residual,
// because a micrometre changes the force by newtons, and a line search takes very short steps (the Maratos
// effect: Nocedal and Wright 2006, section 15.5). Full steps without contacts keep all lengths instead
// (tendon/segment_rotation.cpp). The correction moves the particles to where these elongations cause no
// forces, by the same matrix A:
//
//   A c = -f,     f: the forces s |d_across|^2/(2 l) of all springs along their directions
//
// with the slope s of a spring, its length l, and the part d_across of the difference of the steps of its two
// particles that is normal to it. Other forces take part by their stiffness in A. The arc begins along d, so
// that it descends wherever d does (Mayne and Polak 1982).
#include <algorithm>
#include <cmath>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// residual = the forces of the elongations by rotation. Returns the largest one [N].
double curvature_forces(Tendon& c) {
  double most = 0;
  c.residual.zero();
  for (SpringSet* s : {&c.structure, &c.shear}) {
    if (s->count == 0) continue;
    most = std::max(most, find_curvature_forces(*s, c.dx));
    scatter_forces(*s, c.residual);
  }
  return most;
}

}  // namespace

void find_correction(Island& island, const Options& options) {
  double most = 0;
  for (Tendon* c : island.tendons) most = std::max(most, curvature_forces(*c));
  island.curved = std::isfinite(most) && most > 0;
  if (!island.curved) return;
  clear_loads(island);
  island.curved = answer_forces(island, options, &Tendon::residual, &Tendon::correction);
  combine(island, -1, &Tendon::correction, 0, &Tendon::correction);
  move_bodies(island, -1, &Tendon::correction, &BodyUnknowns::correction);
}

void advance_along_arc(Island& island, double from, double to) {
  const double first = to - from, second = island.curved ? (to - from) * (to + from) : 0;
  for (Tendon* c : island.tendons) c->advance(first, second);
  advance_bodies(island, first, second);
}

double slope_along_arc(const Island& island, double alpha) {
  const double second = island.curved ? 2 * alpha : 0;
  double sum = body_slope(island, second);
  for (const Tendon* c : island.tendons) {
    sum += inner(c->residual, c->dx);
    if (second != 0) sum += second * inner(c->residual, c->correction);
  }
  return sum;
}

}  // namespace bt
