// One substep of an island by the method of the options.
#include <cmath>
#include <limits>

#include "solver/solver.h"

namespace bt {

namespace {

// The mean over the step [N] of a force whose value at the end is known. It is the change of momentum over
// dt. BDF2, v_1 - v_0 = w^2/(1 + 2 w) (v_0 - v_-1) + b F/M, gives w/(1 + 2 w) of the last mean and b/dt of F.
// These factors sum to one.
Vec3 step_mean(const Tendon& c, const StepContext& context, Vec3 last_mean, Vec3 force) {
  const double share = c.h_eff / context.dt;
  return share < 1 ? (1 - share) * last_mean + share * force : force;
}

// Whether positions and velocities are finite, and displacements so small that the length of the tendon
// exceeds their rounding.
bool is_sane(const Tendon& c, const StepContext& context) {
  const double most = c.rest_length() / std::numeric_limits<double>::epsilon();
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < c.n(); ++i)
      if (!(std::fabs(c.x_new[k][i] - c.x[k][i]) <= most) || !(context.dt * std::fabs(c.v_new[k][i]) <= most))
        return false;
  return true;
}

}  // namespace

void solve(Island& island, const StepContext& context) {
  if (context.options.integrator == Integrator::explicit_euler)
    explicit_euler(island, context);
  else if (context.options.iteration == Iteration::single)
    single_linearisation(island, context);
  else
    converged_step(island, context);
  for (Contact* contact : island.contacts)
    contact->force.mean =
        step_mean(island.at(contact->a), context, contact->force.last_mean, contact->force.total);
  for (Tendon* c : island.tendons)
    for (Anchor& h : c->anchors) h.force.mean = step_mean(*c, context, h.force.last_mean, h.force.total);
  island.result.finite &= std::isfinite(island.result.residual);
  for (Tendon* c : island.tendons) island.result.finite &= is_sane(*c, context);
}

}  // namespace bt
