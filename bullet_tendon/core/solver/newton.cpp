// The converged implicit step: a mixed Newton method, which carries multipliers from iteration to iteration.
//
// Every iteration takes the full step. The linear solution predicts the multipliers of springs and contacts,
// and the friction limits. The residual is computed with the true forces. It includes the differences between
// the friction limits and mu N (Coulomb's law). When the residual is small, contacts that press at a
// gap or a depth are stiffened (augmented Lagrangian). Where iteration after iteration others press, contacts
// are softened: next to stiff contacts a taut tendon lies still, so that each iteration would release no more
// than the last of them, and a tendon of more particles would take more iterations.
//
// Friction limits that follow the normal forces have no potential: a contact that closes gets a limit, its
// friction opens it, which takes the limit away, and iterations go round in a cycle. Where the residual does
// not fall, far from the solution, the limits are kept until the forces are nearly balanced at them.
//
// A solution whose residual does not fall goes on as a descent, from where the incremental potential is small
// (begin_descent): plain Newton steps, linearised at the present positions with their true forces. The blocks
// of springs and contacts are positive semidefinite in this linearisation, so that the matrix is positive
// definite and the step descends on the potential, whose gradient is the residual at given friction limits. A
// line search on the slope of the potential shortens the step. Each step keeps the friction limits of the
// last iterate. Near the solution, steps of the mixed method are taken, which converge faster, but only where
// their matrix is definite: a straight tendon that is compressed is a saddle of the potential, which only the
// descent leaves. If this fails too, the Substepper cuts the substep. If it cannot be cut, or the budget is
// exhausted, the end of the descent is accepted: the potential bounds its energy, and bodies move as it does
// (correct_wrenches).
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// Residual, relative to the largest force, below which contacts are linearised completely [-]: with
// curvature, which may make the matrix indefinite, and with friction limits that change within the linear
// solution. Larger: inaccurate normal forces make iterations diverge. Smaller: more iterations.
constexpr double kNear = 0.1;

// Residual, relative to the largest force, below which contacts are stiffened, and the curvature of elements
// is computed [-]. Larger: multipliers are taken from inaccurate forces, and the curvature is that of a place
// far from the solution. Smaller: each stiffness is solved for to an accuracy that is lost with the next one,
// and more iterations converge linearly.
constexpr double kNearSolution = 1e-2;

// Share of the residual that an iteration without this curvature leaves [-]. Larger: it is computed where one
// iteration would be enough without it. Smaller: an iteration is taken that it would have saved.
constexpr double kGaussNewton = 0.05;

// Normal forces on a body, over what contacts move it by, above which it is locked [-]. Larger: what is
// squeezed by a body that friction locks gets larger forces. Smaller: a body that slides along what it
// presses on is taken for one.
constexpr double kLocked = 10;

// Iterations without a new smallest residual after which a solution is abandoned [-]. Fewer: substeps are cut
// that would converge, because the residual may rise temporarily. More: violent steps are slower, because
// most of their iterations belong to solutions that are abandoned.
constexpr int kPatience = 10;

// Iterations without a new smallest residual after which friction limits are kept until the forces are nearly
// balanced [-]. Fewer: loads that slide take more iterations. More: iterations are spent on a cycle.
constexpr int kCycle = 4;

// Residual, relative to that from which a mixed step of a descent led far away, below which the next one is
// tried [-]. Larger: mixed steps and descent alternate. Smaller: the descent, which converges more slowly,
// goes on for longer.
constexpr double kNearer = 0.1;

// Growth of the residual from that of the guess after which the descent begins [-]. Smaller: a solution is
// abandoned in which slack segments and contacts that have parted leave particles free for an iteration.
// Larger: iterations are spent far from the solution, and rounding decides whether they come back.
constexpr double kDivergence = 30;

// Iterations in a row, near the solution, in each of which other contacts press, after which contacts are
// softened [-]. Fewer: contacts are softened that are about to settle. More: iterations are spent.
constexpr int kUnsettled = 3;

// Largest number of trial points of a line search [-]. Fewer: a step along a very inaccurate direction is not
// shortened enough. More: such steps are slower.
constexpr int kMostTrials = 20;

// Displacement of an iterate, relative to that of the inertial target or to the length of the tendon, above
// which the iteration has diverged [-]. Larger: the residual of a diverged iterate is taken for rounding.
// Smaller: a taut tendon that is released may move this far in a long step.
constexpr double kFarOff = 1e3;

// Largest residual that is taken for rounding, in units of machine epsilon x stiffness x coordinate [-].
// Less: far from the origin, equilibria are not recognised, and steps are divided.
constexpr double kRounding = 8.0;

// Displacement, over the segment, by which a tendon at a saddle begins to buckle [-]. Larger: what is a
// saddle only within the tolerance is moved visibly. Smaller: more iterations.
constexpr double kDisturbance = 1e-6;

enum class Next { step, judge, stop };

// The state of one Newton solution.
struct Solution {
  Island& island;
  const StepContext& context;
  bool descends = false;  // uses descent directions and line searches, and mixed steps only near the solution
  bool searches = false;  // the last step was along a descent direction
  bool far = true;        // the relative residual is larger than kNear
  bool turns = false;     // `far` was true in some iteration, so that segments turn
  bool keeps_limits = false;  // friction limits stay in this iteration
  bool changed = false;       // a direct contact became active or inactive in this iteration
  bool disturbed = false;     // a saddle was left
  int iteration = 0;
  int stiffened = 0;          // number of times that contacts were stiffened
  bool stepped = true;        // a step was taken since then
  double trusted = HUGE_VAL;  // residual of a descent below which mixed steps are tried [N]
  // Smallest residual [N] since contacts were stiffened, and the number of iterations since then.
  double smallest = HUGE_VAL;
  double first = 0;  // residual of the guess [N]
  int idle = 0;
  uint64_t pressed = 0;  // hash of the contacts that press
  int unsettled = 0;     // iterations in a row in which others do
  // Residual of the last iteration [N]; infinite if contacts were stiffened since.
  double last_residual = HUGE_VAL;

  const Options& options() const { return context.options; }
  // Largest residual of a converged iterate [N].
  double enough(const Assembly& a) const { return options().tolerance * std::max(a.scale, context.at_hand); }
  void start_anew() {
    smallest = last_residual = HUGE_VAL;
    idle = 0;
  }
};

bool touches(const Island& island) { return !island.acting.empty(); }

// Whether an iterate is so far away that any residual is smaller than its rounding error.
bool ran_away(const Island& island) {
  for (const Tendon* c : island.tendons)
    for (int k = 0; k < 3; ++k) {
      const double meant = std::max(c->rest_length(), largest_of(c->inertial_displacement[k], c->n()));
      if (!(largest_of(c->displacement[k], c->n()) <= kFarOff * meant)) return true;
    }
  return false;
}

// Whether the residual is rounding: kRounding units are allowed if it no longer halves, else one unit.
bool is_rounding(Island& island, const Assembly& a, double last_residual, bool at_guess) {
  const double most = a.residual > 0.5 * last_residual ? kRounding : 1;
  return in_roundings(island, a, at_guess) <= most && !ran_away(island);
}

void begin(Solution& s) {
  Island& island = s.island;
  island.result.left_predicted_region = false;
  for (Contact* contact : island.contacts) contact->normal_force.held = false;
  island.elements.curvature.clear();
  start_bodies(island);
  s.far = !s.context.warm;
}

bool update_directs(Island& island) {
  bool changed = false;
  for (Contact* contact : island.contacts)
    if (contact->normal_force.direct) changed |= update_direct(island, *contact);
  return changed;
}

void note_distance(Solution& s, const Assembly& a) {
  s.far = !(a.residual <= kNear * a.scale);
  s.turns |= s.far;
  if (s.far && s.descends && !s.searches) s.trusted = kNearer * s.last_residual;
}

void note_progress(Solution& s, double residual) {
  s.last_residual = residual;
  ++s.idle;
  if (!(residual < s.smallest)) return;
  s.smallest = residual;
  s.idle = 0;
}

void note_contacts(Solution& s) {
  uint64_t pressed = 0;
  for (const Contact* contact : s.island.contacts)
    if (contact->normal_force.pressed) pressed += hash_of(contact->key);
  s.unsettled = pressed == s.pressed || s.far || s.descends ? 0 : s.unsettled + 1;
  s.pressed = pressed;
}

// Of a soft anchor [J].
double anchor_potential(const Tendon& c, const Anchor& h) {
  if (h.is_line) return h.line.potential();
  const Vec3 stretch = c.x_new.at(h.particle) - h.target.aim;
  const Vec3 v = c.motion().velocity(h.particle) - h.target.velocity;
  const double sum = 0.5 * (dot(stretch, h.stiffness * stretch) + c.h_eff * h.viscosity * dot(v, v));
  const double beyond = h.exceeds_limit(h.raw) ? norm(h.raw) - h.most_force : 0;
  return beyond > 0 ? sum - 0.5 * beyond * beyond / h.slope(c.h_eff).xx : sum;
}

// Of a contact's normal force, and of its friction at the given limit [J].
double contact_potential(const Contact& contact) {
  const NormalForce& normal = contact.normal_force;
  const Friction& friction = contact.friction;
  const double sum = normal.direct ? 0 : 0.5 * normal.value * normal.value / normal.stiffness;
  if (friction.coefficient <= 0 || friction.limit <= 0) return sum;
  const double stretch = norm(friction.raw), most = friction.limit / friction.stiffness;
  const double beyond = std::max(0.0, stretch - most);
  return sum + 0.5 * friction.stiffness * (stretch * stretch - beyond * beyond);
}

// The incremental potential at the evaluated iterate [J], whose gradient is the residual at the present
// friction limits.
double potential(const Island& island) {
  double sum = body_potential(island) + element_potential(island);
  for (const Contact* contact : island.contacts)
    if (contact->acts()) sum += contact_potential(*contact);
  for (const Tendon* c : island.tendons) {
    for (int i = 0; i < c->n(); ++i) {
      const Vec3 off = (1 / c->h_eff) * (c->displacement.at(i) - c->inertial_displacement.at(i));
      sum += 0.5 * c->mass[i] * dot(off, off);
    }
    for (const SpringSet* s : {&c->structure, &c->shear}) sum += stored_energy(*s, c->material.law);
    sum += bending_energy(*c, c->x_new);
    for (const Anchor& h : c->anchors)
      if (!h.rigid) sum += anchor_potential(*c, h);
  }
  return sum;
}

// Friction limits of a descent, by the normal forces at its iterate. The normal force of a direct contact is
// that before the line search. Its limit is kept.
void take_limits(Island& island) {
  for (Contact* contact : island.contacts)
    if (!contact->normal_force.direct) contact->limit_friction(contact->normal_force.value);
}

// Computes the residual at the iterate, and whether it is small enough.
Assembly judge(Solution& s) {
  Island& island = s.island;
  // As the last step was found: multipliers decide about the contacts of a mixed step, also in a descent.
  Assembly a = residual_of(island, s.searches);
  s.changed = update_directs(island);
  measure_residual(island, a);
  island.result.residual = a.scale > 0 ? a.residual / a.scale : a.residual;
  // The residual of a tendon at rest is that of its rounded positions.
  const bool at_guess = s.iteration == 0 && !s.context.warm;
  const bool enough = a.residual <= s.enough(a) || is_rounding(island, a, s.last_residual, at_guess);
  island.result.converged = !s.changed && enough;
  note_distance(s, a);
  if (s.iteration == 0) s.first = a.residual;
  note_progress(s, a.residual);
  s.keeps_limits = s.idle >= kCycle && a.of_forces > kNear * a.scale;
  note_contacts(s);
  return a;
}

// Sets all particles to their positions at the start of the substep, except for anchored ones.
void place_at_start(Island& island) {
  for (Tendon* c : island.tendons) {
    c->displacement.zero();
    c->x_new = c->x;
    c->place_anchors();
  }
  place_bodies(island);
}

// Places all particles at their displacements dx, except for anchored ones.
void place_at_dx(Island& island) {
  for (Tendon* c : island.tendons) {
    c->displacement.zero();
    c->advance(1);
    c->place_anchors();
  }
}

// Whether a link moves, if its body does.
bool presses(const Island& island, bool moves, int link) {
  return moves && !island.bodies.body(island.bodies.link(link).body).is_held_firmly();
}

// What presses on particles and may give way: bodies and springs, and hands, which slip at their limit.
enum Presser : char { kBody = 1, kHand = 2 };

char presser_of(const Island& island, const Anchor& h) {
  if (h.most_force > 0) return kHand;
  return !h.rigid || presses(island, h.moves, h.link) ? kBody : 0;
}

// Of a contact: those of its particles, and its link.
char pressers_of(const Island& island, const Contact& contact) {
  char found = presses(island, contact.moves, contact.link) ? kBody : 0;
  for (const SegmentPoint& s : {contact.a, contact.b})
    for (int i = s.first; s.tendon >= 0 && i <= s.first + (s.w1 > 0); ++i) found |= island.at(s).pressed[i];
  return found;
}

// Marks the particles that they press on, directly or through other tendons.
void mark_pressed(Island& island) {
  for (Tendon* c : island.tendons) {
    c->pressed.assign(c->n(), 0);
    for (const Anchor& h : c->anchors) c->pressed[h.particle] |= presser_of(island, h);
  }
  for (bool any = true; std::exchange(any, false);)
    for (const Contact* contact : island.contacts) {
      const char found = pressers_of(island, *contact);
      for (const SegmentPoint& s : {contact->a, contact->b})
        for (int i = s.first; s.tendon >= 0 && i <= s.first + (s.w1 > 0); ++i) {
          char& mark = island.at(s).pressed[i];
          any |= std::exchange(mark, static_cast<char>(mark | found)) != (mark | found);
        }
    }
}

// Where the forces overpower what holds a body, larger ones would not say more.
bool stiffen_contacts(Island& island, const StepContext& context) {
  const IslandBodies& bodies = island.bodies;
  const auto may_stiffen = [](const Contact* contact) { return contact->may_stiffen(); };
  if (std::none_of(island.contacts.begin(), island.contacts.end(), may_stiffen)) return false;
  const bool may_be_released = std::any_of(bodies.indices.begin(), bodies.indices.end(), [&](int slot) {
    return bodies.body(slot).holds_to_unknown_limit();
  });
  island.result.overpowered = bodies_are_overpowered(island, *context.substeps);
  if (island.result.overpowered) return false;
  mark_pressed(island);
  const bool may_show =
      may_be_released || (!bodies.indices.empty() && !contacts_lock_bodies(island, kLocked));
  bool any = false;
  for (Contact* contact : island.contacts) {
    const char found = pressers_of(island, *contact);
    any |= contact->stiffen(found != 0, found == kHand || (found != 0 && may_show));
  }
  return any;
}

bool soften_contacts(Island& island) {
  bool any = false;
  for (Contact* contact : island.contacts) any |= contact->soften();
  return any;
}

// Computes Newton's step with the second derivatives of the potential. false: they are not definite, which
// `indefinite_too` allows those of the tendons.
bool find_exact_step(Solution& s, bool indefinite_too) {
  residual_of(s.island, true);
  assemble(s.island, Linearisation::position, false, false);
  return solve_linear(s.island, s.context, false, indefinite_too);
}

// Advances along the arc to a point where the slope has at least halved, by regula falsi, or to its end, if
// the slope is not positive there. Where the curvature along the arc is negative, it goes on beyond its end:
// the step of a positive definite matrix is a small share of the way from a saddle. It uses slopes only,
// because differences of the potential would suffer from cancellation.
void line_search(Solution& s) {
  Island& island = s.island;
  const double start = slope_along_arc(island, 0);
  find_correction(island, s.options());
  double lo = 0, hi = HUGE_VAL, slope_lo = start, slope_hi = 0, at = 0, alpha = 1;
  for (int trial = 0; trial < kMostTrials; ++trial) {
    advance_along_arc(island, at, alpha);
    at = alpha;
    Assembly a = residual_of(island, true);
    measure_residual(island, a);
    const double slope = slope_along_arc(island, alpha);
    const bool finite = std::isfinite(slope), first = hi == HUGE_VAL;
    if (finite && slope <= 0 && slope > (first ? slope_lo : 0.5 * slope_lo)) return;
    if (finite && std::fabs(slope) <= 0.5 * std::fabs(slope_lo)) return;
    if (finite && slope < 0) {
      lo = alpha;
      slope_lo = slope;
    } else {
      hi = alpha;
      slope_hi = finite ? slope : 1e3 * std::fabs(start);
    }
    if (hi == HUGE_VAL) {
      alpha *= 2;
      continue;
    }
    const double width = hi - lo;
    const double guess = lo - slope_lo * width / (slope_hi - slope_lo);
    alpha = std::min(std::max(guess, lo + 0.1 * width), hi - 0.1 * width);
  }
}

// Whether the solution is a saddle of the potential: tendons are straight that would buckle at any
// disturbance.
bool is_saddle(Solution& s) { return has_struts(s.island) && !find_exact_step(s, false); }

// Leaves a saddle along the mode in which the struts buckle: a little, and on from there if the potential
// falls.
void leave_saddle(Solution& s) {
  Island& island = s.island;
  s.disturbed = s.descends = s.searches = true;
  s.start_anew();
  if (!find_exact_step(s, true) || !find_buckling_mode(island, s.options())) return;
  advance_along_arc(island, 0, kDisturbance);
  residual_of(island, true);
  if (slope_along_arc(island, 0) < 0) line_search(s);
}

// After an iteration with a small residual: stiffens contacts, leaves a saddle, or ends the solution.
Next refine(Solution& s) {
  Island& island = s.island;
  if (s.stepped && s.stiffened < kMostCorrections && stiffen_contacts(island, s.context)) {
    ++s.stiffened;
    s.stepped = false;
    s.start_anew();
    return Next::judge;
  }
  if (island.result.converged && !s.disturbed && s.context.may_halve && is_saddle(s)) {
    leave_saddle(s);
    return Next::judge;
  }
  if (island.result.converged) return Next::stop;
  island.result.left_predicted_region = s.context.may_detect && !s.context.budget->exhausted() &&
                                        touches(island) && leaves_predicted_region(island);
  return island.result.left_predicted_region ? Next::stop : Next::step;
}

Next decide(Solution& s, const Assembly& a, int start) {
  Island& island = s.island;
  const bool near = s.iteration > 0 && !s.changed && a.residual <= kNearSolution * a.scale;
  if (island.result.converged || near) {
    const Next next = refine(s);
    if (next != Next::step) return next;
  }
  if (s.unsettled >= kUnsettled && soften_contacts(island)) {
    s.unsettled = 0;
    s.start_anew();
    return Next::judge;
  }
  if (s.iteration - start >= s.options().max_iterations) return Next::stop;
  // The potential of a descent falls, also where a tendon buckles and the residual grows. Where the substep
  // cannot be cut, that is the only way on.
  if (s.idle > kPatience && (!s.descends || s.context.may_halve)) return Next::stop;
  if (!std::isfinite(a.residual)) return Next::stop;
  if (a.residual > s.smallest && ran_away(island)) return Next::stop;
  if (!s.descends && a.residual > kDivergence * std::max(s.smallest, s.first)) return Next::stop;
  if (s.iteration > start && s.context.budget->refuses_solve()) return Next::stop;
  return Next::step;
}

// The curvature of elements helps near the solution alone, and costs more than it saves where one iteration
// without it is enough.
void curve_elements(Solution& s, const Assembly& a, double enough) {
  IslandElements& elements = s.island.elements;
  if (elements.all.empty() || !elements.curvature.empty()) return;
  if (a.residual < kNearSolution * a.scale && a.residual * kGaussNewton > enough) find_curvature(elements);
}

// Computes the step of particles (tendon.dx) and bodies. false: the linear solution failed.
bool find_step(Solution& s, const Assembly& a) {
  Island& island = s.island;
  const double enough = s.enough(a);
  // A more exact step would not reduce the residual of this iteration further.
  island.matrix.tolerance = 0.05 * enough / a.residual;
  s.searches = s.descends;
  if (!s.descends || (s.context.may_halve && !s.far && a.residual < s.trusted)) {
    curve_elements(s, a, enough);
    assemble(island, Linearisation::multiplier, false, s.far);
    if (solve_linear(island, s.context, false)) {
      s.searches = false;
      if (!s.far) solve_limits(island, s.context, enough);
      return true;
    }
    // The matrix is indefinite: solve again without the indefinite terms of compression and contacts.
    residual_of(island, s.descends);
  }
  assemble(island, s.descends ? Linearisation::position : Linearisation::multiplier, true, true);
  return solve_linear(island, s.context, true);
}

void take_step(Solution& s) {
  Island& island = s.island;
  s.stepped = true;
  island.curved = false;
  if (s.searches) {
    line_search(s);
    for (Tendon* c : island.tendons)
      for (Anchor& h : c->anchors) h.slip_if_beyond();
    take_limits(island);
    return;
  }
  carry_springs(island);
  predict_contacts(island, s.keeps_limits, s.far);
  predict_anchors(island);
  advance_along_arc(island, 0, 1);
  // Contacts are stiff across the tendon. With contacts, the positions of particles matter more than the
  // lengths of segments.
  if (s.turns && !touches(island))
    for (Tendon* c : island.tendons) keep_lengths(*c);
}

// Resets the iterate: particles and bodies do not move in this substep, except for rigid anchors. The
// iterate is put aside in dx and dy.
void stay(Island& island) {
  for (Tendon* c : island.tendons) c->dx = c->displacement;
  put_bodies_aside(island);
  place_at_start(island);
}

double evaluated_potential(Island& island) {
  residual_of(island, false);
  return potential(island);
}

// Begins the descent of a solution that failed: from its last iterate, if its potential is smaller than that
// of no motion, else from no motion.
void begin_descent(Solution& s) {
  Island& island = s.island;
  const double reached = potential(island);
  stay(island);
  if (reached < evaluated_potential(island)) {
    place_at_dx(island);
    advance_bodies(island, 1);
  }
  s.descends = s.searches = true;
  s.start_anew();
}

// Whether the residual would move no particle, by itself, by more than the tolerance times a segment in this
// substep. Where almost no forces act, it cannot always become a small share of them.
bool is_negligible(const Solution& s) {
  if (s.island.tendons.empty()) return false;
  double least = HUGE_VAL;
  for (const Tendon* c : s.island.tendons)
    least = std::min(least, *std::min_element(c->mass.begin(), c->mass.end()) * c->shortest_rest() /
                                (c->h_eff * c->h_eff));
  return s.last_residual <= s.options().tolerance * least && !ran_away(s.island);
}

// Iterates until the solution ends.
void iterate(Solution& s) {
  Island& island = s.island;
  for (const int start = s.iteration;; ++s.iteration) {
    const Assembly a = judge(s);
    const Next next = decide(s, a, start);
    if (next == Next::judge) continue;
    if (next == Next::stop || !find_step(s, a)) break;
    take_step(s);
  }
  if (island.result.converged || island.result.left_predicted_region || s.changed) return;
  island.result.converged = is_negligible(s);
}

void end(Solution& s) {
  Island& island = s.island;
  for (Contact* contact : island.contacts)
    if (contact->normal_force.held)
      contact->force.total += contact->normal_force.value * contact->geometry.normal;  // the constraint force
  find_worst(island);
  island.result.iterations += s.iteration;
}

// Solves the implicit step of the island. tendon.x_new is the starting guess, and then the result.
void newton(Island& island, const StepContext& context) {
  Solution s{island, context};
  const auto failed = [&] { return !island.result.converged && !island.result.left_predicted_region; };
  begin(s);
  iterate(s);
  if (failed()) {
    begin_descent(s);
    iterate(s);
    if (failed() && context.takes_any()) correct_wrenches(island);
  }
  end(s);
}

bool by_euler(const Island& island, const StepContext& context) {
  return std::all_of(island.tendons.begin(), island.tendons.end(),
                     [&](const Tendon* c) { return c->h_eff == context.dt; });
}

}  // namespace

bool leaves_predicted_region(const Island& island) {
  return std::any_of(island.tendons.begin(), island.tendons.end(),
                     [](const Tendon* c) { return leaves_predicted_region(*c); });
}

void converged_step(Island& island, const StepContext& context) {
  newton(island, context);
  if (island.result.converged) bend_straight_struts(island);
  for (Tendon* c : island.tendons) find_velocities(*c);
  if (!island.result.left_predicted_region && (island.result.converged || context.takes_any()) &&
      by_euler(island, context))
    project_energy(island, context.gravity);
}

}  // namespace bt
