// What a Newton solution does that its full steps do not solve: half steps, steps along a line, and beginning
// anew.
#include "solver/globalisation.h"

#include <algorithm>
#include <cmath>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/missed_contacts.h"

namespace bt {

namespace {

// A step is solved again at most this often, because friction limits moved with the normal forces by
// more than the share [-] given, or pairs were missed. Fewer: such changes lag by a step. Larger share: what
// slides is off by as much, and rounding decides by how much.
constexpr double kFrictionAccuracy = 1e-6;

double slope_along(Group& group) {
  double sum = body_slope(group);
  for (Chain* c : group.chains) sum += inner(c->residual, c->step);
  return sum;
}

BT_VECTOR void advance_particles(Chain& c, double alpha) {
  const int n = c.n();
  for (int k = 0; k < 3; ++k) {
    double *x = c.next[k], *tail = c.next_tail[k];
    const double* d = c.step[k];
#pragma GCC ivdep
    for (int i = 0; i < n; ++i) {
      double at = x[i], rest = tail[i];
      add_exactly(at, rest, alpha * d[i]);
      x[i] = at, tail[i] = rest;
    }
  }
}

}  // namespace

void advance(Group& group, double alpha) {
  for (Chain* c : group.chains) advance_particles(*c, alpha);
  advance_bodies(group, alpha);
}

void halve_step(Group& group) {
  for (Chain* c : group.chains)
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) c->step[k][i] *= 0.5;
  for (double& y : group.corner_side) y *= 0.5;
  move_bodies(group, -1, &Chain::step);
}

// Regula falsi on the slope; no potential needed, so no cancellation.
void line_search(Group& group) {
  const double start = slope_along(group);
  double at = 0, lo = 0, hi = 0, alpha = 1, slope_lo = start, slope_hi = 0;
  for (int trial = 0; trial < 24; ++trial) {
    advance(group, alpha - at);
    at = alpha;
    Assembly a = residual_of(group, true, true);
    measure_residual(group, a);
    double slope = slope_along(group);
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

void restart_from_now(Group& group) {
  for (Chain* c : group.chains) {
    c->next = c->x, c->next_tail.zero();
    for (const Hold& h : c->holds)
      if (h.rigid) c->next.set(h.particle, h.aim);
  }
  forget_bodies(group);
}

namespace {

// What follows a solution, between the rounds of Newton's method.

// true: some friction limit moved by more than `enough`.
bool update_friction(Group& group, double enough) {
  bool moved = false;
  for (Row* row : group.rows) {
    if (row->friction <= 0) continue;
    double limit = row->friction * row->normal_force;
    moved |= std::fabs(limit - row->limit) > std::max(enough, kFrictionAccuracy * limit);
    row->limit_friction(limit);
  }
  return moved;
}

// true: some contact was too deep, and has been made stiffer.
bool stiffen(Group& group) {
  bool any = false;
  for (Row* row : group.rows) any |= row->stiffen();
  return any;
}

}  // namespace

bool Rounds::next(Group& group, int iteration, double enough) {
  const bool slid = update_friction(group, enough);
  const bool missed = add_missed(group);
  const bool deep = stiffen(group);
  if (!slid && !missed && !deep) return false;
  ++count_, begun_ = iteration, fresh_ = true;
  return true;
}

}  // namespace bt
