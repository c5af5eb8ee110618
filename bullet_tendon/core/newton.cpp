// The converged implicit step: Newton's method with carried multipliers, and its safeguard.
#include <array>
#include <limits>

#include "assembly.h"
#include "constants.h"
#include "pairs.h"

namespace bt {

namespace {

void advance(Group& group, double alpha) {
  for (Chain* c : group.chains)
    for (int k = 0; k < 3; ++k) {
      double* x = c->next[k];
      const double* d = c->step[k];
      for (int i = 0; i < c->n(); ++i) x[i] += alpha * d[i];
    }
  advance_bodies(group, alpha);
  travel(group, alpha);
}

// Sets of contacts that follow each other in a circle, or get nowhere, are left by going half the way.
void halve_step(Group& group) {
  for (Chain* c : group.chains)
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) c->step[k][i] *= 0.5;
  for (double& y : group.corner_side) y *= 0.5;
  step_bodies(group);
}

double slope_along(Group& group) {
  double sum = body_slope(group);
  for (Chain* c : group.chains) sum += inner(c->residual, c->step);
  return sum;
}

// The safeguard: along a direction of descent, a length at which the slope of the step's potential
// has at least halved (regula falsi on the slope; no potential needed, so no cancellation).
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

// Whether iterations still get anywhere: contacts along a straight wall are let go one by one, which
// takes many iterations and is no reason to give up.
struct Progress {
  int patience = kMixedIterations;
  double best = std::numeric_limits<double>::infinity();
  int idle = 0;
  std::array<double, kLongestCircle> seen{};  // the last residuals
  size_t count = 0;
};

bool repeats(Progress& p, double residual) {
  const bool again = std::any_of(p.seen.begin(), p.seen.end(), [&](double r) {
    return std::fabs(r - residual) <= kSameResidual * residual;
  });
  p.seen[p.count++ % p.seen.size()] = residual;
  return again;
}

Progress fresh_progress(const Group& group) {
  Progress p;
  p.patience =
      std::min(kMostPatience, kMixedIterations + static_cast<int>(group.rows.size()) / kContactsAnIteration);
  return p;
}

bool stalled(Progress& p, double residual) {
  ++p.idle;
  if (residual < kProgress * p.best) p.best = residual, p.idle = 0;
  return p.idle > p.patience;
}

// Friction limits follow the normal forces between solutions, each of which minimises a fixed
// potential.
// true: some limit moved by more than `enough`, and the step has to be solved again.
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

// Rounds of that: from which iteration on this one is solved, and how well before the next.
struct Rounds {
  int count = 0, begun = 0;
  double loose = kLooseRound;  // residual over the forces at hand
  bool fresh = false;          // what it begins with is not known yet
};

void begin_round(Rounds& r, int iteration) { ++r.count, r.begun = iteration, r.fresh = true; }

void note_start(Rounds& r, double residual) {
  if (r.fresh) r.loose = kNextRound * residual, r.fresh = false;
}

bool any_strays(const Group& group) {
  return std::any_of(group.chains.begin(), group.chains.end(), [](const Chain* c) { return strays(*c); });
}

// Iterates so far off that rounding would excuse any residual.
bool ran_away(const Group& group) {
  for (const Chain* c : group.chains)
    for (int k = 0; k < 3; ++k) {
      const double meant = std::max(largest_of(c->x[k], c->n()), largest_of(c->goal[k], c->n()));
      const double length = c->rest[0] * c->n();
      if (!(largest_of(c->next[k], c->n()) <= kFarOff * std::max(meant, length))) return true;
    }
  return false;
}

// Within a few roundings, what does not shrink any more is rounding.
bool is_rounding(Group& group, const Assembly& a, double last_residual) {
  const double most = a.residual > 0.5 * last_residual ? kRounding : 1;
  return in_roundings(group, a) <= most && !ran_away(group);
}

// Contacts are stiff across the tendon: there it matters more where particles are than how long segments are,
// but for what strikes another tendon, or itself, while it turns far.
bool may_keep_lengths(const Group& group, bool violent) {
  return std::none_of(group.acting.begin(), group.acting.end(),
                      [violent](const Row* row) { return !violent || row->link >= 0; });
}

bool touches(const Group& group) { return !group.acting.empty(); }

bool turns_far(const Group& group) {
  return std::any_of(group.chains.begin(), group.chains.end(),
                     [](const Chain* c) { return c->turn > kTurned; });
}

// The guess was useless: begin at the state that is known to be finite.
void restart_from_now(Group& group) {
  for (Chain* c : group.chains) {
    c->next = c->x;
    for (const Hold& h : c->holds)
      if (h.rigid) c->next.set(h.particle, h.target);
  }
  forget_bodies(group);
  wake(group);
}

}  // namespace

void newton(Group& group, const StepContext& context, bool safeguarded) {
  const Options& o = context.options;
  const bool violent = turns_far(group);
  bool safe = false, far = !context.goes_on, turns = violent;
  int used = 0, lost = 0;
  Rounds rounds;
  group.most_jump = std::numeric_limits<double>::infinity(), group.stayed = false;
  Progress progress = fresh_progress(group);
  // Of the last iteration; none where it was not a whole one, so that what is left is not taken for rounding.
  constexpr double kNone = std::numeric_limits<double>::infinity();
  double last_residual = kNone;
  group.strays = false;
  for (Row* row : group.rows) {
    row->held = false, row->changes = 0;
    row->stays &= context.goes_on;
  }
  start_bodies(group);
  start_waiting(group);
  group.follows = o.linear_solver != LinearSolver::pcg;  // which knows blocks of rows only
  for (int iteration = 0;; ++iteration) {
    Assembly a = residual_of(group, safe, safe || far);
    bool changed = false;
    for (Row* row : group.rows)
      if (row->direct) changed |= update_direct(group, *row);
    measure_residual(group, a);
    used = iteration;
    group.residual = a.scale > 0 ? a.residual / a.scale : a.residual;
    const bool enough = a.residual <= o.tolerance * a.scale || is_rounding(group, a, last_residual);
    last_residual = a.residual;
    const bool was_far = far;
    far = !(a.residual <= (far ? kNear : kLost) * a.scale);
    if (was_far && !far) wake(group);
    turns |= far;  // a guess that was near is corrected along lines
    lost += far && !was_far;
    group.most_jump = kMostJump * std::pow(kLessJump, lost) * a.scale;
    group.converged = !changed && enough;
    note_start(rounds, group.residual);
    const bool more = rounds.count < kRounds;
    // What turns far has its limits settled within iterations.
    const bool loosely =
        more && !violent && !safe && !far && iteration > rounds.begun && group.residual <= rounds.loose;
    if (group.converged || (loosely && !changed)) {
      if (!more) break;
      const bool slid = update_friction(group, o.tolerance * a.scale);
      const bool missed = add_missed(group);
      const bool deep = stiffen(group);
      if (slid || deep || missed) {
        begin_round(rounds, iteration), progress = fresh_progress(group), last_residual = kNone;
        continue;
      }
      if (group.converged) break;
      group.strays = context.may_look && touches(group) && any_strays(group);
      if (group.strays) break;
      rounds.loose = 0;
    }
    if (iteration - rounds.begun >= o.max_iterations) break;
    if (!safe && (stalled(progress, a.residual) || !std::isfinite(a.residual))) {
      if (!safeguarded) break;
      safe = true;
      if (!std::isfinite(a.residual)) restart_from_now(group);
      continue;
    }
    if (group.stayed && add_missed(group)) {
      group.stayed = false, progress = fresh_progress(group), last_residual = kNone;
      continue;
    }
    const bool circles = !safe && (repeats(progress, a.residual) || progress.idle > kIdle);
    // As exact as this iteration can make use of.
    group.linear_tolerance = std::min(kLoosest, 0.05 * o.tolerance * a.scale / a.residual);
    assemble(group, safe ? Linearisation::position : Linearisation::multiplier, safe, safe || far);
    bool solved = solve_linear(group, context, safe);
    if (!solved) {  // indefinite: once more, with compression cut off
      residual_of(group, safe, true);
      assemble(group, safe ? Linearisation::position : Linearisation::multiplier, true, true);
      solved = solve_linear(group, context, true);
    }
    if (!solved) {  // out of numbers
      if (safe || !safeguarded) break;
      safe = true, restart_from_now(group);
      continue;
    }
    if (circles) halve_step(group), last_residual = kNone;
    measure_stride(group);
    if (safe) {
      line_search(group);
    } else {
      for (Chain* c : group.chains)
        for (SpringSet* s : {&c->structure, &c->shear})
          if (s->count) carry(*s, c->material.law, c->step);
      foresee_contacts(group);
      if (violent)
        for (Row* row : group.acting) row->settle_limits();
      advance(group, 1);
      if (turns && may_keep_lengths(group, violent)) {
        for (Chain* c : group.chains) violent ? pull_to_lengths(*c) : keep_lengths(*c);
        wake(group);
      }
    }
  }
  measure_waiting(group, safe || far);
  for (Row* row : group.rows)
    if (row->held) row->total_force += row->normal_force * row->normal;  // what the constraint supplied
  find_worst(group);
  group.iterations += used;
}

}  // namespace bt
