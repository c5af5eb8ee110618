// What a Newton solution does that its full steps do not solve: half steps, steps along a line, and beginning
// anew.
#include "solver/globalisation.h"

#include <algorithm>
#include <cmath>

#include "solver/assembly.h"
#include "solver/body_schur.h"

namespace bt {

namespace {

// A step is solved again at most this often, because friction limits moved with the normal forces by
// more than the share [-] given. Larger: what slides is off by as much, and rounding decides by how much.
constexpr double kFrictionAccuracy = 1e-6;

double slope_along(Island& island) {
  double sum = body_slope(island);
  for (Tendon* c : island.tendons) sum += inner(c->residual, c->dx);
  return sum;
}

BT_VECTOR void advance_particles(Tendon& c, double alpha) {
  const int n = c.n();
  for (int k = 0; k < 3; ++k) {
    double *u = c.displacement[k], *x_new = c.x_new[k];
    const double *d = c.dx[k], *x = c.x[k];
#pragma GCC ivdep
    for (int i = 0; i < n; ++i) {
      u[i] += alpha * d[i];
      x_new[i] = x[i] + u[i];
    }
  }
}

}  // namespace

void advance(Island& island, double alpha) {
  for (Tendon* c : island.tendons) advance_particles(*c, alpha);
  advance_bodies(island, alpha);
}

void halve_step(Island& island) {
  for (Tendon* c : island.tendons)
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) c->dx[k][i] *= 0.5;
  for (double& y : island.corner_side) y *= 0.5;
  move_bodies(island, -1, &Tendon::dx);
}

// Regula falsi on the slope; no potential needed, so no cancellation.
void line_search(Island& island) {
  const double start = slope_along(island);
  double at = 0, lo = 0, hi = 0, alpha = 1, slope_lo = start, slope_hi = 0;
  for (int trial = 0; trial < 24; ++trial) {
    advance(island, alpha - at);
    at = alpha;
    Assembly a = residual_of(island, true, true);
    measure_residual(island, a);
    double slope = slope_along(island);
    bool finite = std::isfinite(slope);
    if (finite && slope <= 0 && (alpha == 1 || slope >= 0.5 * start)) return;
    if (finite && std::fabs(slope) <= 0.5 * std::fabs(start)) return;
    if (finite && slope < 0) {
      lo = alpha, slope_lo = slope;
    } else {
      hi = alpha, slope_hi = finite ? slope : 1e3 * std::fabs(start);
    }
    double guess = hi > lo ? lo - slope_lo * (hi - lo) / (slope_hi - slope_lo) : 2 * alpha;
    double width = hi - lo;
    alpha = std::min(std::max(guess, lo + 0.1 * width), hi - 0.1 * width);
  }
}

void restart_from_now(Island& island) {
  for (Tendon* c : island.tendons) {
    c->x_new = c->x;
    c->displacement.zero();
    for (const Anchor& h : c->anchors)
      if (h.rigid) c->place(h.particle, h.aim);
  }
  forget_bodies(island);
}

namespace {

// What follows a solution, between the rounds of Newton's method.

// true: some friction limit moved by more than `enough`.
bool update_friction(Island& island, double enough) {
  bool moved = false;
  for (Contact* contact : island.contacts) {
    if (contact->friction <= 0) continue;
    double limit = contact->friction * contact->normal_force;
    moved |= std::fabs(limit - contact->limit) > std::max(enough, kFrictionAccuracy * limit);
    contact->limit_friction(limit);
  }
  return moved;
}

// true: some contact was too deep, and has been made stiffer.
bool stiffen(Island& island) {
  bool any = false;
  for (Contact* contact : island.contacts) any |= contact->stiffen();
  return any;
}

}  // namespace

bool Rounds::next(Island& island, int iteration, double enough) {
  const bool slid = update_friction(island, enough);
  const bool deep = stiffen(island);
  if (!slid && !deep) return false;
  ++count_, begun_ = iteration, fresh_ = true;
  return true;
}

}  // namespace bt
