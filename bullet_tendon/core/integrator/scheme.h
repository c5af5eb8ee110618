// Time integration of a tendon (paper, section 4.2).
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
#include "integrator/substepper.h"
#include "tendon/tendon.h"

namespace bt {

// Largest ratio of a step to the last step with which BDF2 continues [-]: 1 + sqrt(2), its stability limit
// (Grigorieff 1983). With larger ratios it restarts.
constexpr double kMostGrowth = 2.414;

struct StepContext {
  double dt = 0;           // length of the substep [s]
  double tissue_time = 0;  // that passes for tissue: dt, or 0 while bodies are held at rest [s]
  double reach = 0;        // s of bodies/body_response.h [s]
  double at_hand = 0;      // largest force beside those of the step, of which the tolerance is, too [N]
  const Substepper* substeps = nullptr;
  bool may_halve = false;  // the substep is halved if it does not converge
  Budget* budget = nullptr;
  bool warm = false;  // starts from the last solution, with newly detected contacts
  // Contacts may be detected again: a solution may end early where it leaves the predicted region.
  bool may_detect = false;
  Vec3 gravity;
  Options options;

  // Whether a solution that has not converged is taken.
  bool takes_any() const { return !may_halve || budget->exhausted(); }
};

// Computes the history, the inertial target y and the starting guess of a
// tendon.
void begin_step(Tendon& c, const StepContext& context);

// Computes v_new from the displacement.
void find_velocities(Tendon& c);
// Whether the velocities of a tendon jump in this step of dt (integrator/scheme.cpp).
bool is_jolted(const Tendon& c, double dt);
// Makes x_new and v_new the new state.
void finish_step(Tendon& c, const StepContext& context);

}  // namespace bt
