#include "bodies/joint_motors.h"

#include <algorithm>
#include <cmath>

#include "bodies/bounded_rows.h"
#include "bodies/response_observer.h"
#include "math/rounding.h"

namespace bt {

namespace {

bool is_same(double force, double before) {
  return std::fabs(force - before) <= kRoundingShare * std::fabs(force);
}

// Whether it gave at least as much as ever, but for noise.
bool is_greatest(const JointMotor& m, double force) {
  return std::fabs(force) >= (1 - kLeastNews) * m.greatest;
}

// Whether its aim is known: it is not where it pushes at its limit and went faster than was foreseen.
bool is_aim_known(const JointMotor& m) { return std::fabs(m.aim) < kMostRate; }

// The direction in which it pushed; of one that was switched off, in which it was to push.
int direction(const JointMotor& m, double force) { return (force != 0 ? force : m.needed) > 0 ? 1 : -1; }

// What a motor that pushes with this force was short of the foreseen one, as a share of that [-].
double missing_share(const JointMotor& m, double force) {
  const double needed = direction(m, force) * m.needed;
  return needed > 0 ? 1 - std::fabs(force) / needed : 0;
}

// Whether it is at its limit. One that gives less than before, and less than was needed, has a lower limit or
// another aim now: the latter if it was within a limit that is known, or if its aims have changed by as much.
// A change that is foreseen and one that comes may differ in sign: what is missing is up to twice a change.
bool is_at_limit(const JointMotor& m, double reached, double force) {
  const double off = direction(m, force) * (m.foreseen - reached);
  if (!m.known || !m.solved) return false;
  if (is_same(std::fabs(force), m.limit)) return std::fabs(off) > kSolverNoise;
  if (!(off > kSolverNoise) || !is_aim_known(m)) return false;
  if (is_same(force, m.force)) return true;
  if (is_greatest(m, force)) return missing_share(m, force) > kLeastNews;
  const bool may_be_lower = m.side != 0 || (m.limit == kUnlimited && off > 2 * m.leap);
  return may_be_lower && missing_share(m, force) > kEvidence;
}

// Whether it released its joint: it was not foreseen to give as little as it did at its limit.
bool has_released(const JointMotor& m, double reached, double force) {
  return is_at_limit(m, reached, force) && missing_share(m, force) > kLeastNews;
}

// At its limit, it goes no faster than its aim: beyond the aim that was foreseen, it has another one.
void yield_at(JointMotor& m, double reached, double force) {
  m.limit = m.greatest = std::fabs(force);
  m.side = direction(m, force);
  const bool beyond = m.side * (reached - m.foreseen) > kSolverNoise;
  m.aim = beyond ? m.side * kMostRate : m.foreseen;
  m.gained = m.trend = 0;
}

void hold(JointMotor& m, double reached, double force, double dt) {
  const double before = m.gained, size = std::fabs(force);
  if (m.side == 0) m.leap = std::max(m.leap, std::fabs(reached - m.aim));
  m.gained = is_aim_known(m) ? (reached - m.aim) / dt : 0;
  m.trend = before * m.gained <= 0 ? 0 : std::fabs(before) < std::fabs(m.gained) ? before : m.gained;
  m.aim = reached;
  m.side = 0;
  if (size > (1 + kRoundingShare) * m.limit) m.limit = kUnlimited;
  m.greatest = std::max(m.greatest, size);
}

JointMotor starting(double reached, double force) {
  JointMotor m;
  m.known = force != 0;
  m.aim = m.foreseen = reached;
  m.force = force;
  m.greatest = std::fabs(force);
  return m;
}

}  // namespace

bool JointMotors::released(const Numbers& reached, const Numbers& forces) const {
  for (size_t i = 0; i < std::min(all.size(), forces.size()); ++i)
    if (has_released(all[i], reached[i], forces[i])) return true;
  return false;
}

bool JointMotors::observe(const Numbers& reached, const Numbers& forces, double dt) {
  if (all.size() != forces.size()) all.assign(forces.size(), {});
  const bool any = released(reached, forces);
  for (size_t i = 0; i < all.size(); ++i) {
    JointMotor& m = all[i];
    if (has_released(m, reached[i], forces[i]))
      yield_at(m, reached[i], forces[i]);
    else if (!m.known || forces[i] == 0)
      m = starting(reached[i], forces[i]);
    else if (is_at_limit(m, reached[i], forces[i]))
      yield_at(m, reached[i], forces[i]);
    else
      hold(m, reached[i], forces[i], dt);
    m.force = forces[i];
  }
  return any;
}

void JointMotors::add_cut_off(const Numbers& reached, const Numbers& cut_off, Numbers& forces) const {
  for (size_t i = 0; i < std::min(all.size(), forces.size()); ++i)
    if (forces[i] != 0 && std::fabs(reached[i] - all[i].foreseen) <= kEvidence * kMostRate)
      forces[i] += cut_off[i];
}

void JointMotors::begin(const Numbers& rates) {
  if (!all.empty() || reported.size() != rates.size()) return;
  for (size_t i = 0; i < rates.size(); ++i) all.push_back(starting(rates[i], reported[i]));
  reported_before = reports;
}

void JointMotors::foresee(double dt) {
  for (JointMotor& m : all) m.foreseen = m.aim + (again ? 0 : dt * m.trend);
}

}  // namespace bt
