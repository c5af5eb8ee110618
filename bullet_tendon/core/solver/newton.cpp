// The converged implicit step: Newton's method with carried multipliers, and its safeguard
// (solver/globalisation.cpp).
#include "solver/newton.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/energy_projection.h"
#include "solver/friction_limits.h"
#include "solver/globalisation.h"
#include "solver/island_step.h"
#include "solver/linear_solve.h"
#include "tendon/segment_rotation.h"

namespace bt {

namespace {

// Residual over the forces at hand under which the curvature of a mouth's edge, which may make the matrix
// indefinite, is believed [-]. Larger: wild normal forces throw iterations off. Smaller: what slides over an
// edge takes more of them.
constexpr double kNear = 0.2;
// The same from which it is not believed any more.
constexpr double kLost = 0.5;

// Loosest relative accuracy of conjugate gradients within Newton's method [-].
constexpr double kLoosest = 1e-2;

// Displacements of iterates, in those that the step aims at or lengths of the tendon, beyond which they have
// run away [-]. Larger: a residual there passes for rounding. Smaller: a taut tendon let go may snap back so
// far in a long step.
constexpr double kFarOff = 1e3;

// Rounding allowance on a force, in units of (machine epsilon x stiffness x coordinate) [-].
constexpr double kRounding = 8.0;

constexpr double kNone = std::numeric_limits<double>::infinity();

enum class Next { step, iterate, stop };

// One solution on its way.
struct Solution {
  Island& island;
  const StepContext& context;
  bool safeguarded;      // may be
  bool safe = false;     // is safeguarded
  bool far = true;       // from the solution
  bool turns = false;    // was far from it at some time, so that segments turn
  bool changed = false;  // what constrains particles directly
  bool circles = false;
  int iteration = 0;
  Rounds rounds;
  Progress progress{0};
  // Of the last iteration; none where it was not a whole one, so that what is left is not taken for rounding.
  double last_residual = kNone;

  const Options& options() const { return context.options; }
  void start_anew() { progress = Progress(island.contacts.size()), last_residual = kNone; }
};

bool touches(const Island& island) { return !island.acting.empty(); }

bool any_left_predicted_region(const Island& island) {
  return std::any_of(island.tendons.begin(), island.tendons.end(),
                     [](const Tendon* c) { return leaves_predicted_region(*c); });
}

// Iterates so far off that rounding would excuse any residual.
bool ran_away(const Island& island) {
  for (const Tendon* c : island.tendons)
    for (int k = 0; k < 3; ++k) {
      const double meant = std::max(c->rest_length(), largest_of(c->inertial_displacement[k], c->n()));
      if (!(largest_of(c->displacement[k], c->n()) <= kFarOff * meant)) return true;
    }
  return false;
}

// Within a few roundings, what does not shrink any more is rounding.
bool is_rounding(Island& island, const Assembly& a, double last_residual, bool at_guess) {
  const double most = a.residual > 0.5 * last_residual ? kRounding : 1;
  return in_roundings(island, a, at_guess) <= most && !ran_away(island);
}

Solution begin(Island& island, const StepContext& context, bool safeguarded) {
  island.left_predicted_region = false;
  for (Contact* contact : island.contacts) contact->held = false, contact->changes = 0;
  start_bodies(island);
  island.follows = context.options.linear_solver != LinearSolver::pcg;  // which knows blocks of contacts only
  Solution s{island, context, safeguarded};
  s.far = !context.warm;
  s.start_anew();
  return s;
}

bool update_directs(Island& island) {
  bool changed = false;
  for (Contact* contact : island.contacts)
    if (contact->direct) changed |= update_direct(island, *contact);
  return changed;
}

// How far from the solution, after a residual.
void note_distance(Solution& s, const Assembly& a) {
  const bool was_far = s.far;
  s.far = !(a.residual <= (was_far ? kNear : kLost) * a.scale);
  s.turns |= s.far;  // a guess that was near is corrected along lines
}

// The residual, and whether it is small enough.
Assembly judge(Solution& s) {
  Island& island = s.island;
  Assembly a = residual_of(island, s.safe, s.safe || s.far);
  s.changed = update_directs(island);
  measure_residual(island, a);
  island.residual = a.scale > 0 ? a.residual / a.scale : a.residual;
  // What rests is where its rounded positions leave it.
  const bool at_guess = s.iteration == 0 && !s.context.warm;
  const bool enough =
      a.residual <= s.options().tolerance * a.scale || is_rounding(island, a, s.last_residual, at_guess);
  island.converged = !s.changed && enough;
  s.last_residual = a.residual;
  note_distance(s, a);
  s.rounds.note_start(island.residual);
  return a;
}

// Where the solution, or a round of it, is at its end.
Next end_round(Solution& s, const Assembly& a) {
  Island& island = s.island;
  const bool settled = s.safe || s.far || s.changed || s.rounds.over();
  if (!island.converged && (settled || !s.rounds.near_end(s.iteration, island.residual))) return Next::step;
  if (s.rounds.over()) return Next::stop;
  if (s.rounds.next(island, s.iteration, s.options().tolerance * a.scale)) {
    s.start_anew();
    return Next::iterate;
  }
  if (island.converged) return Next::stop;
  island.left_predicted_region = s.context.may_look && touches(island) && any_left_predicted_region(island);
  s.rounds.settle();
  return island.left_predicted_region ? Next::stop : Next::step;
}

// The guess was useless, or iterations get nowhere: with the safeguard from now on.
Next guard(Solution& s, bool anew) {
  if (s.safe || !s.safeguarded) return Next::stop;
  s.safe = true;
  if (anew) restart_from_now(s.island);
  return Next::iterate;
}

Next watch(Solution& s, const Assembly& a) {
  if (s.iteration - s.rounds.begun() >= s.options().max_iterations) return Next::stop;
  if (s.context.budget->exhausted() && s.iteration > 0) return Next::stop;
  const bool finite = std::isfinite(a.residual);
  if (!s.safe && (s.progress.stalled(a.residual) || !finite)) return guard(s, !finite);
  s.circles = !s.safe && s.progress.circles(a.residual);
  return Next::step;
}

// Of limits, that is worth a solution [N].
double least_change(const Solution& s, const Assembly& a) {
  return kLimitAccuracy * s.options().tolerance * a.scale;
}

// The next step of the particles and bodies, in tendon.dx.
Next find_step(Solution& s, const Assembly& a) {
  Island& island = s.island;
  const Linearisation how = s.safe ? Linearisation::position : Linearisation::multiplier;
  // As exact as this iteration can make use of.
  island.linear_tolerance = std::min(kLoosest, 0.05 * s.options().tolerance * a.scale / a.residual);
  assemble(island, how, s.safe, s.safe || s.far);
  if (solve_linear(island, s.context, s.safe)) {
    if (!s.safe && !s.far) solve_limits(island, s.context, least_change(s, a));
    return Next::step;
  }
  // Indefinite: once more, with compression cut off.
  residual_of(island, s.safe, true);
  assemble(island, how, true, true);
  return solve_linear(island, s.context, true) ? Next::step : guard(s, true);
}

// Friction's limits follow the forces that are foreseen: of contacts about whose force two iterations are at
// odds, not yet.
void settle_limits(Solution& s) {
  for (Contact* contact : s.island.acting)
    if (contact->agrees(contact->lambda_predicted)) contact->settle_friction();
}

void take_step(Solution& s) {
  Island& island = s.island;
  if (s.circles) halve_step(island), s.last_residual = kNone;
  if (s.safe) return line_search(island);
  carry_springs(island);
  predict_contacts(island);
  settle_limits(s);
  advance(island, 1);
  // Contacts are stiff across the tendon: there it matters more where particles are than how long segments
  // are.
  if (!s.turns || touches(island)) return;
  for (Tendon* c : island.tendons) keep_lengths(*c);
}

void end(Solution& s) {
  Island& island = s.island;
  for (Contact* contact : island.contacts)
    if (contact->held)
      contact->total_force += contact->normal_force * contact->normal;  // what the constraint supplied
  find_worst(island);
  island.iterations += s.iteration;
}

}  // namespace

void newton(Island& island, const StepContext& context, bool safeguarded) {
  Solution s = begin(island, context, safeguarded);
  for (;; ++s.iteration) {
    const Assembly a = judge(s);
    Next next = end_round(s, a);
    if (next == Next::step) next = watch(s, a);
    if (next == Next::step) next = find_step(s, a);
    if (next == Next::stop) break;
    if (next == Next::step) take_step(s);
  }
  if (context.budget->exhausted() && !std::isfinite(island.residual)) {
    restart_from_now(island);
    judge(s);
  }
  end(s);
}

namespace {

bool by_euler(const Island& island, const StepContext& context) {
  return std::all_of(island.tendons.begin(), island.tendons.end(),
                     [&](const Tendon* c) { return c->h_eff == context.dt; });
}

}  // namespace

void converged_step(Island& island, const StepContext& context) {
  newton(island, context, !context.may_halve);
  for (Tendon* c : island.tendons) find_velocities(*c);
  if (!island.left_predicted_region && (island.converged || !context.may_halve) && by_euler(island, context))
    project_energy(island, context.gravity);
}

}  // namespace bt
