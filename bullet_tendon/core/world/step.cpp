// One step of a world. The step is divided into substeps where motion leaves the range of contact detection,
// or where an island does not converge.
//
// Contacts are detected at the start of a substep, in the region where particles are predicted to move. If a
// solution leaves this region, the predicted positions are moved to it and contacts are detected again.
// Contacts that exist in both detections keep their multipliers, and the solution is the starting guess. The
// new region includes the active contacts of the solution, so that two detections cannot alternate.
//
// Each substep is a complete implicit step with its own contacts. A link is where pybullet would have it if
// the step ended with the substep: at the time since the step began, times its velocity. Known forces and
// those of earlier substeps have changed that velocity in proportion to their time. The wrenches on links are
// averaged over the substeps, so that impulses are exact. A penetration depth at the start of a substep is
// corrected in proportion to the substep's share of the remaining step. Otherwise a short substep would turn
// the depth into a very large velocity.
//
// When a substep is solved again, only the multipliers are restored. The state changes only in take_substep.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "solver/solver.h"
#include "world/world.h"

namespace bt {

namespace {

// Largest slack of a particle that left its predicted region [radii]. Larger: after a solution that went far,
// everything is near everything. Smaller: contacts are detected again more often.
constexpr double kMostSlack = 8;

// BDF2 divides a step in which a segment is predicted to turn by more than this sine [-]. Larger: the fast
// motion of a whip's end is lost. Smaller: fast rotation costs more.
constexpr double kTurn = 0.6;

// Target of each grip at the end of the substep, which moves there from that of the last substep. A rigid
// grip moves its particle from where it is. share: the substep's share of the remaining step [-]. dt: length
// of the substep [s]; 0: targets are at rest.
void aim_grips(Tendon& c, double share, double dt) {
  for (Anchor& h : c.anchors) {
    if (h.link >= 0) continue;
    h.target.lead(h.rigid ? c.x.at(h.particle) : h.target.last_aim, share, dt);
  }
}

}  // namespace

bool World::step(double dt, Vec3 gravity, bool whole, DistanceOracle& oracle) {
  using Clock = std::chrono::steady_clock;
  auto seconds_since = [](Clock::time_point t) {
    return std::chrono::duration<double>(Clock::now() - t).count();
  };
  const auto start = Clock::now();
  if (!step_.attempted) start_budget(oracle);
  begin_step_of_world(dt, gravity, whole);
  predict();
  while (!step_.substeps.done()) {
    if (step_.substeps.taken() > 0 && !step_.substeps.ends_early() && step_.budget.refuses()) end_early();
    if (step_.substeps.ends_early() && !any_moves()) break;
    const auto asked = Clock::now();
    update_proximity(oracle);
    step_.report.near_seconds += seconds_since(asked);
    const std::optional<Reason> again = solve_substep();
    if (step_.failed && step_.substeps.taken() > 0)
      outlast_failure();
    else if (step_.failed)
      break;
    else if (again)
      solve_again(*again);
    else
      take_substep();
  }
  if (step_.substeps.ends_early()) finish_left_out();
  if (step_.failed) {
    step_.report.take(step_.attempt);
    step_.report.add(step_.substeps.reasons());
  } else {
    finish_step_of_world();
  }
  step_.report.solve_seconds = seconds_since(start) - step_.report.near_seconds;
  step_.resolved = true;
  return !step_.failed;
}

void World::start_budget(DistanceOracle& oracle) {
  step_.budget.start(options.max_linear_solves, options.time_budget, [&oracle] { oracle.poll(); });
  step_.resolved = false;
}

void World::begin_step_of_world(double dt, Vec3 gravity, bool whole) {
  step_.context.gravity = gravity;
  step_.context.options = options;
  step_.context.substeps = &step_.substeps;
  step_.context.budget = &step_.budget;
  step_.context.at_hand = whole ? step_.at_hand : 0;
  step_.whole = whole;
  step_.left_out.clear();
  find_solid_links();
  step_.substeps.start(dt, !whole && carries(options));
  for (Link& l : scene.links) l.wrench = {};
  history_.may_resolve = !whole && any_moved();
  for (GeneralizedBody& m : scene.bodies) {
    m.turning.far = m.turning.elements = m.stays = false;
    m.begin_step();
    m.history.asked = false;
  }
  mark_touchable_bodies();
  for (Link& l : scene.links) {
    l.attachment_arms = {};
  }
  if (history_.may_resolve) {
    history_.start->sensed_links = scene.links;
    history_.start->sensed_bodies = scene.bodies;
  }
  wake_tendons();
  step_.unsolved.assign(scene.tendons.size(), 0);
  step_.unsolved_bodies.assign(scene.bodies.size(), 0);
  Report fresh;
  if (step_.resolved) {
    step_.substeps.repeat(Reason::released);
    fresh.iterations = step_.report.iterations;
    fresh.reasons = step_.report.reasons;
  }
  step_.report = fresh;
  step_.stop_changes = 0;
}

// Lets all tendons that do not go on sleeping take part in the step, and all elements.
void World::wake_tendons() {
  step_.slots.clear();
  wake_disturbed(step_.substeps.step());
  join_step();
  if (scene.has_elements()) count_touches();
}

// Computes history, inertial targets, starting guess and predicted region of every tendon.
void World::predict() {
  step_.context.dt = step_.substeps.h();
  step_.context.tissue_time = step_.whole ? 0 : step_.context.dt;
  step_.detections = 0;
  continue_histories();
  find_turning();
  find_point_masses();
  for (GeneralizedBody& m : scene.bodies) m.unknowns.y.clear();
  step_.context.reach = std::sqrt(step_.substeps.end() * step_.context.dt);
  lead_bodies();
  foresee_ends();
  foresee_links();
  for (auto [slot, c] : filled(step_.slots)) {
    aim_attachments(c);
    aim_grips(c, step_.substeps.share_left(), step_.whole ? 0 : step_.context.dt);
    begin_step(c, step_.context);
    c.place_anchors();
    c.predict();
    expect_carried(c);
  }
  if (!step_.whole) each_acting([&](Element& element) { element.begin(scene.links, step_.context.dt); });
  find_bores();
}

// Solves the substep once. Returns the reason to solve it again, if any.
std::optional<Reason> World::solve_substep() {
  step_.failed = false;
  if (const auto why = outlast_history()) return why;
  contacts_.all.swap(contacts_.solved);
  limit_motion();
  if (!step_.substeps.ends_early() && wake_met()) return Reason::woken;
  const bool may_limit = step_.substeps.ends_early() ? any_limited() : step_.substeps.may_cut();
  if (step_.motion_limit < 1 && may_limit) return Reason::motion;
  collect_contacts();
  const bool again = step_.detections > 0;
  if (!again || step_.substeps.ends_early() || !contacts_.all.empty() || !contacts_.solved.empty()) {
    if (again) inherit_multipliers();
    if (share_weights()) return Reason::step_weights;
    if (const auto why = solve_islands()) return why;
    if (step_.failed) return {};
    if (step_.substeps.may_cut() && solution_passes_cartilage()) return Reason::motion;
    if (!step_.budget.exhausted() && restart_jolted()) return Reason::step_weights;
  }
  if (!any_moved() || step_.budget.refuses()) return {};
  if (limit_holds()) return Reason::released;
  if (const auto why = settle_stops()) return why;
  if (find_turning()) return Reason::body_rotation;
  return {};
}

// Whether a BDF2 step has to be divided at its start. A step in which a segment turns far is divided into
// three substeps, or into two where a tendon is in contact, because substeps with contacts take more
// iterations. A step that is so much longer than the last one that BDF2 would restart is divided into two.
std::optional<Reason> World::outlast_history() {
  if (!is_second_order(options.integrator) || !step_.substeps.divisible() || !step_.substeps.is_whole() ||
      step_.detections > 0)
    return {};
  bool turns = false, touched = false, grows = false;
  for (auto [slot, c] : filled(step_.slots)) {
    turns |= greatest_turn(c) > kTurn;
    touched |= c.touched;
    const double growth = c.dt_before > 0 ? step_.context.dt / c.dt_before : 1;
    grows |= growth > kMostGrowth && growth <= 2 * kMostGrowth;
  }
  if (!turns) return grows ? std::optional(Reason::growth) : std::nullopt;
  step_.parts = touched ? 2 : 3;
  return Reason::turn;
}

std::optional<Reason> World::solve_islands() {
  find_unknowns();
  make_islands();
  if (step_.substeps.ends_early()) leave_out_near();
  step_.context.warm = step_.detections > 0;
  const bool may_cut = step_.substeps.may_cut();
  const bool may_detect = step_.substeps.divisible() &&
                          (step_.detections < kMostDetections || (may_cut && !step_.budget.exhausted()));
  step_.context.may_detect = may_detect;
  step_.context.may_halve = may_cut || step_.substeps.ends_early();
  const bool finite = solve_each_island();
  if (step_.substeps.ends_early()) leave_out_unsolved(!may_detect);
  if (may_cut && (!finite || (step_.unconverged && !step_.budget.refuses()))) return Reason::not_converged;
  step_.failed = !finite && !step_.substeps.ends_early();
  if (step_.failed) return {};
  if (overpowers() && !step_.budget.refuses())
    if (const auto why = settle_stops()) return why;
  if (may_detect && ((solution_leaves() && predict_at_solution()) || foresee_at_solution()))
    return Reason::left_prediction;
  if (may_cut && step_.budget.exhausted() && outruns_prediction()) return Reason::motion;
  if (step_.whole && !stiffness.links.empty()) find_tendon_stiffness();
  return {};
}

void World::solve_again(Reason why) {
  if (why == Reason::left_prediction && step_.detections < kMostDetections) {
    step_.substeps.repeat(why);
    step_.detections = step_.budget.exhausted() ? kMostDetections : step_.detections + 1;
    return;
  }
  if (step_.substeps.ends_early() && why == Reason::motion) leave_out_limited();
  // What holds a body acts evenly in the whole step: if that has changed, the body was elsewhere in the
  // substeps that are finished.
  if (why == Reason::released && step_.substeps.taken() > 0)
    begin_again(why);
  else if (step_.substeps.ends_early())
    step_.substeps.repeat(why);
  else if (why == Reason::motion)
    step_.substeps.cut(why, step_.motion_limit);
  else if (why == Reason::not_converged || why == Reason::left_prediction)
    step_.substeps.cut(why, 0.5);
  else if (why == Reason::turn || why == Reason::growth)
    step_.substeps.divide(why, why == Reason::turn ? step_.parts : 2);
  else
    step_.substeps.repeat(why);
  for (auto [slot, c] : filled(step_.slots)) c.restore_multipliers();
  predict();
}

// No smaller substep has a finite solution. What was solved ends the step.
void World::outlast_failure() {
  step_.failed = step_.report.converged = false;
  for (auto [slot, c] : filled(step_.slots)) c.restore_multipliers();
  end_early();
}

// Whether contacts are to be detected again where the solution leaves the predicted region. Once the budget
// is exhausted, only for islands that are solved.
bool World::solution_leaves() const {
  if (!step_.budget.exhausted()) return true;
  return std::any_of(islands_.all.begin(), islands_.all.end(), [](const Island& g) {
    return (g.result.converged || g.result.left_predicted_region) && leaves_predicted_region(g);
  });
}

// Whether an iterate that is taken without another detection may have passed through something: a particle is
// farther from its prediction than its radius. Finds the share of the substep in which none is: what forces
// add to the prediction goes with the square of the time.
bool World::outruns_prediction() {
  double most = 1;
  for (auto [slot, c] : filled(step_.slots))
    for (int i = 0; i < c.n(); ++i)
      most = std::max(most, norm(c.x_new.at(i) - c.predicted.at(i)) / std::max(c.radius, c.slack[i]));
  step_.motion_limit = 1 / std::sqrt(most);
  return most > 1;
}

// Moves the predicted region of particles that left it to their solved positions. true: some particles left
// it.
bool World::predict_at_solution() {
  bool any = false;
  for (auto [slot, c] : filled(step_.slots)) {
    if (!leaves_predicted_region(c)) continue;
    any = true;
    for (int i = 0; i < c.n(); ++i) {
      const double off = norm(c.x_new.at(i) - c.predicted.at(i));
      if (!(off > c.slack[i])) continue;
      c.slack[i] = kSlack * c.radius + std::min(0.5 * off, kMostSlack * c.radius);
      c.most_slack = std::max(c.most_slack, c.slack[i]);
      c.predicted.set(i, c.x_new.at(i));
    }
  }
  return any;
}

// Contacts that also existed in the previous solution of this substep start from its multipliers.
void World::inherit_multipliers() {
  static thread_local std::vector<const Contact*> solved;  // keeps its memory from step to step
  solved.clear();
  for (const Contact& contact : contacts_.solved) solved.push_back(&contact);
  auto by_key = [](const Contact* a, const Contact* b) { return a->key < b->key; };
  std::sort(solved.begin(), solved.end(), by_key);
  for (Contact& contact : contacts_.all) {
    const auto found = std::lower_bound(solved.begin(), solved.end(), &contact, by_key);
    if (found == solved.end() || !((*found)->key == contact.key)) continue;
    const Contact& last = **found;
    contact.normal_force.stiffness = last.normal_force.stiffness;
    contact.normal_force.lambda = last.normal_force.lambda;
    contact.normal_force.lambda_predicted = last.normal_force.lambda_predicted;
    contact.normal_force.first_gap = last.normal_force.first_gap;
    contact.normal_force.squeezed = last.normal_force.squeezed;
    contact.friction.limit = last.friction.limit;
    contact.friction.sliding = last.friction.sliding;
  }
}

// Computes what this substep adds to the step's mean wrenches on links.
void World::measure_wrenches() {
  const double share = step_.substeps.share();
  for (Link& l : scene.links) {
    l.part = share * l.correction;
    l.history.excess_now = {};
  }
  auto push = [&](Link& link, Vec3 given, Vec3 end, Vec3 arm) {
    const double two_step = link.yields() ? scene.bodies[link.body].history.share() : 1;
    const Vec3 force = two_step < 1 ? two_step * two_step * end : given;
    link.part.force += share * force;
    link.part.torque += share * link.torque_of(force, arm);
    if (link.iterate.turned.far)
      link.history.excess_now += cross(link.now(arm), end) - link.torque_of(end, arm);
  };
  // Means over the last steps point as forces did half a step earlier, and what they give half a step before
  // that. Links whose forces move nothing bear them there (bodies/body_history.h).
  auto borne_at = [&](const Link& link, const Tendon& c, Vec3 start, Vec3 end) {
    if (link.yields() || c.h_eff == step_.context.dt) return end;
    return gives_twice(c) ? start : 0.5 * (start + end);
  };
  for (Contact& contact : contacts_.all) {
    const Tendon& c = *step_.slots[contact.a.tendon];
    contact.force.given = given(c, contact.force.mean, contact.force.last_given);
    if (contact.link < 0) continue;
    Link& link = scene.links[contact.link];
    const Vec3 start = contact.acts_at_centre() ? contact.arm : contact.a.of(c.x) - link.centre;
    push(link, -contact.force.given, -contact.force.total, borne_at(link, c, start, contact.arm));
  }
  each_anchor(step_.slots, [&](const Tendon& c, const Anchor& h) {
    if (h.link < 0) return;
    Link& link = scene.links[h.link];
    const Vec3 arm = borne_at(link, c, link.arm_of(h.local), link.held_arm_of(h.local));
    push(link, given(c, h.force.mean, h.force.of_step), h.force.total, arm);
  });
  if (step_.whole) return;
  const double square = step_.substeps.end() * step_.substeps.step();
  for (Link& l : scene.links)
    if (l.yields() && l.iterate.turned.far)
      l.part.torque +=
          (1 / square) * (scene.bodies[l.body].inertia.moments * l.iterate.turned.beyond_theta());
  each_acting([&](const Element& element) {
    for (const TouchedLink& touched : element.touched()) {
      Link& link = scene.links[touched.link];
      link.part.force += share * touched.force;
      link.part.torque += share * transposed_times(link.iterate.turned.rate, touched.torque);
    }
  });
}

// Makes the solution the new state, and applies its wrenches to the links.
void World::take_substep() {
  step_.report.take(step_.attempt);
  const double share = step_.substeps.share();
  measure_wrenches();
  for (Link& l : scene.links) l.wrench = l.wrench + l.part;
  each_anchor(step_.slots, [&](const Tendon& c, Anchor& h) {
    h.force.last_mean = h.force.mean;
    h.force.sum += share * given(c, h.force.mean, h.force.of_step);
  });
  remember();
  for (auto [slot, c] : filled(step_.slots)) {
    c.with_body = c.coupled && step_.substeps.is_whole();
    finish_step(c, step_.context);
    c.let_overlaid_part();
  }
  share_weights();
  if (!step_.whole) each_acting([](Element& element) { element.accept(); });
  if (!stiffness.links.empty()) keep_held();
  if (after_substep) after_substep();
  if (step_.substeps.is_last()) return step_.substeps.accept();
  push_bodies();
  step_.substeps.accept();
  for (auto [slot, c] : filled(step_.slots)) c.keep_multipliers();
  step_.stop_changes = 0;
  predict();
}

void World::finish_step_of_world() {
  step_.report.substeps = step_.substeps.taken();
  step_.report.add(step_.substeps.reasons());
  step_.report.linear_solves = step_.budget.spent();
  step_.report.over_budget = step_.budget.refused();
  step_.report.converged &= !step_.report.over_budget;
  if (!step_.whole) act_on_bodies();
  begin_histories();
  each_anchor(step_.slots, [](const Tendon&, Anchor& h) { h.force.of_step = h.force.sum; });
  find_coarse_turns();
  find_flat_cartilage();
  if (!step_.whole) history_.last_step = {step_.substeps.step(), step_.context.gravity};
  push_asleep();
  let_read();
  step_.report.asleep = std::count_if(scene.tendons.begin(), scene.tendons.end(),
                                      [](auto& c) { return c && c->sleeping_island >= 0; });
  fall_asleep();
}

// Predicts particles on bodies where these are foreseen to be under the last forces.
void World::expect_carried(Tendon& c) {
  for (const Anchor& h : c.anchors) {
    if (!h.carries()) continue;
    const Link& link = scene.links[h.link];
    c.predicted.set(h.particle, h.target.aim + link.foreseen.given.at(link.arm_of(h.local)));
  }
}

// Sets the targets of attached particles. A target is the attached point on the link, predicted without the
// tendon forces of this substep. The unknowns of the body move the point from there (solver/body_schur.cpp).
// A point mass has no unknowns: with s^2 = (time from the start of the step to the end of the substep)
// (length of the substep), the force F moves the mass m by s^2 F/m. Therefore a spring of stiffness m/s^2
// holds the particle. Explicit steps have no body unknowns. If pybullet moved the body differently from the
// prediction in the last step, the distance between particle and point is closed evenly over the substeps.
void World::aim_attachments(Tendon& c) {
  for (Anchor& h : c.anchors) {
    if (h.link < 0) continue;
    const Link& link = scene.links[h.link];
    const Vec3 p = to_world(link.pose, h.local);
    h.target.aim = link.ahead_of(h.local, step_.context.dt);
    const bool unknown = link.yields() && options.integrator != Integrator::explicit_euler;
    if (h.is_line) {
      h.moves = unknown;
      h.line.begin(h.target.aim, step_.whole);
      continue;
    }
    h.target.aim += (1 - step_.substeps.share_left()) * (c.x.at(h.particle) - p);
    h.rigid = !link.yields() || !scene.bodies[link.body].point_mass;
    h.moves = h.rigid && unknown;
    if (!h.rigid) {
      const double reach = step_.context.reach, share = scene.bodies[link.body].history.share();
      h.stiffness = identity(1 / (share * share * reach * reach * scene.bodies[link.body].free[0]));
    }
  }
}

void World::interrupt() {
  for (auto [slot, c] : filled(scene.tendons)) c.smooth = false;
  for (GeneralizedBody& m : scene.bodies) m.history.smooth = false;
}

bool World::any_moved() const {
  return std::any_of(scene.links.begin(), scene.links.end(), [](const Link& l) { return l.yields(); });
}

}  // namespace bt
