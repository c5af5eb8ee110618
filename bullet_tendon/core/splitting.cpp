// A step of tendons by themselves that Newton's method does not solve is taken in parts: halved until
// every part converges. (Where they touch something, the world splits the step: parts.cpp.)
//
// Rotations grow with the step and are what Newton fails on; inertia M/b^2 grows as the step
// shrinks and makes every part solvable in the end. Parts are counted in units of dt / kMostSubsteps
// and doubled again when they go well. Forces on holders and bodies are the parts' averages, so that
// impulses stay exact.
#include <algorithm>
#include <cmath>

#include "constants.h"
#include "stepping.h"

namespace bt {

namespace {

void keep_multipliers(Group& group) {
  for (Chain* c : group.chains) c->keep_multipliers(c->start);
  for (Row* row : group.rows) row->kept_multiplier = row->multiplier, row->kept_sliding = row->sliding;
}

void restore_multipliers(Group& group) {
  for (Chain* c : group.chains) c->restore_multipliers(c->start);
  for (Row* row : group.rows) row->multiplier = row->kept_multiplier, row->sliding = row->kept_sliding;
}

void add_means(Group& group, double weight) {
  for (Row* row : group.rows) row->mean_force += weight * row->total_force;
  for (Chain* c : group.chains)
    for (Hold& h : c->holds) {
      h.mean_force += weight * h.force;
      if (h.link >= 0) h.mean_torque += weight * torque_of(group, h, h.force);
    }
}

void clear_means(Group& group) {
  for (Row* row : group.rows) row->mean_force = {};
  for (Chain* c : group.chains)
    for (Hold& h : c->holds) h.mean_force = h.mean_torque = {};
}

// Attachments that stand for a body by a spring: what parts before have done to the body, F~ by their shares,
// and this one does, moves it from the start of the step on (parts.cpp), by e W (F~ + s F) with e the share
// of the step at the part's end and s its own.
std::vector<Sym3> whole_springs(const Group& group) {
  std::vector<Sym3> all;
  for (const Chain* c : group.chains)
    for (const Hold& h : c->holds) all.push_back(h.stiffness);
  return all;
}

void set_springs(Group& group, const std::vector<Sym3>& whole, double share) {
  const Sym3* k = whole.data();
  for (Chain* c : group.chains)
    for (Hold& h : c->holds) {
      Sym3 w = *k++;
      if (h.link < 0 || h.rigid) continue;
      h.stiffness = (1 / (group.part_end * share)) * w;
      if (invert_definite(w)) h.target += group.part_end * (w * h.mean_force);
    }
}

void put_back_springs(Group& group, const std::vector<Sym3>& whole) {
  const Sym3* k = whole.data();
  for (Chain* c : group.chains)
    for (Hold& h : c->holds) h.stiffness = *k++;
}

// The parts have moved x and v: the end goes to next and step, x and v back to the start.
void gather(Chain& c) {
  c.next = c.x, c.step = c.v;
  c.x = c.start_x, c.v = c.start_v;
  c.x_before = c.start_x_before, c.v_before = c.start_v_before, c.dt_before = c.start_dt_before;
  c.split = false, c.gathered = true;
}

void in_parts(Group& group, const StepContext& context) {
  StepContext part = context;
  part.goes_on = part.may_look = false;
  part.options.integrator = Integrator::implicit_euler;
  for (Chain* c : group.chains) {
    c->start_x = c->x, c->start_v = c->v, c->split = true;
    c->start_x_before = c->x_before, c->start_v_before = c->v_before, c->start_dt_before = c->dt_before;
    c->dt_before = 0;
  }
  for (Chain* c : group.chains) c->restore_multipliers(c->kept);
  for (Row* row : group.rows) row->multiplier = row->kept_multiplier, row->sliding = row->kept_sliding;
  clear_means(group);
  start_parts(group);
  group.substeps = 0;
  bool converged = true;
  double worst = 0;
  const std::vector<Sym3> springs = whole_springs(group);
  for (int done = 0, size = kMostSubsteps / 2; done < kMostSubsteps;) {
    part.dt = context.dt * size / kMostSubsteps;
    keep_multipliers(group);
    const double share = static_cast<double>(size) / kMostSubsteps;
    group.part_end = static_cast<double>(done + size) / kMostSubsteps;
    group.part_root = std::sqrt(group.part_end * share);
    for (Chain* c : group.chains) begin_step(*c, part, group.part_end);
    set_springs(group, springs, share);
    newton(group, part, size == 1);
    if (!group.converged && size > 1) {
      size /= 2;
      restore_multipliers(group);
      continue;
    }
    converged &= group.converged;
    worst = std::max(worst, group.residual);
    keep_passive(group);
    add_means(group, share);
    gather_bodies(group, share);
    for (Chain* c : group.chains) finish_step(*c, part);
    ++group.substeps;
    done += size;
    if (size < kMostSubsteps / 2 && done % (2 * size) == 0) size *= 2;
  }
  group.converged = converged, group.residual = worst;
  group.part_end = group.part_root = 1;
  for (Chain* c : group.chains) gather(*c);
  put_back_springs(group, springs);
}

bool by_euler(const Group& group, const StepContext& context) {
  return std::all_of(group.chains.begin(), group.chains.end(),
                     [&](const Chain* c) { return c->b == context.dt; });
}

}  // namespace

void converged_step(Group& group, const StepContext& context) {
  newton(group, context, context.splitting == Splitting::never);
  if (group.strays) return;
  const bool by_world = context.splitting == Splitting::by_world && !group.rows.empty();
  if (!group.converged && !by_world && context.splitting != Splitting::never)
    in_parts(group, context);
  else if (by_euler(group, context))
    keep_passive(group);
}

}  // namespace bt
