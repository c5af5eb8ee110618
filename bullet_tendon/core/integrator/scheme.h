// Time stepping (paper, section 4.2): one step of a group of tendons that touch each other.
//
// With b the step weight and history positions and velocities xh, vh,
//
//   implicit Euler   b = dt,       xh = x_0,                vh = v_0
//   BDF2             b = 2 dt/3,   xh = (4 x_0 - x_-1)/3,   vh = (4 v_0 - v_-1)/3
//     after a step of another length, dt/w:
//                    b = (1 + w)/(1 + 2 w) dt,   xh = x_0 + w^2/(1 + 2 w) (x_0 - x_-1),   vh likewise
//
// the end of the step solves (7), written for positions, with y = xh + b vh + b^2 M^-1 f_ext:
//
//   r(x) = M (x - y) / b^2 - f(x, (x - xh)/b) = 0,     v = (x - xh)/b.
//
// Newton's matrix is M/b^2 + sum of spring blocks (tendon/axial_springs.h) + contact blocks
// (contact/contact.h).
#pragma once
#include "integrator/options.h"
#include "integrator/step_budget.h"
#include "tendon/tendon.h"

namespace bt {

// Growth of a step from the last one up to which BDF2 goes on [-]: 1 + sqrt(2), where it ceases to be stable
// (Grigorieff 1983). After shorter ones it is restarted.
constexpr double kMostGrowth = 2.414;

struct StepContext {
  double dt = 0;
  double reach = 0;        // s of bodies/body_response.h [s]
  bool may_halve = false;  // a solution that does not converge is given up, and the substep cut
  Budget* budget = nullptr;
  bool whole = false;     // the step's length means nothing: it is a way to rest
  bool part = false;      // of a step: what touches something takes it by implicit Euler
  bool warm = false;      // from the last solution, with more rows
  bool may_look = false;  // for rows where particles stray: solutions are left for that before they are exact
  Vec3 gravity;
  Options options;
};

// History, goal y, starting guess and held particles of a tendon.
void begin_step(Tendon& c, const StepContext& context);

// tendon.v_new, from the displacement.
void find_velocities(Tendon& c);
// Whether two-step methods may continue with a tendon that touches something, after a step of dt
// (integrator/scheme.cpp).
bool goes_smoothly(const Tendon& c, double dt);
// Takes tendon.x_new and v_new as the new state.
void finish_step(Tendon& c, const StepContext& context);

}  // namespace bt
