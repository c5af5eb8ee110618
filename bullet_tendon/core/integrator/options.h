// Solver options of the user (SolverOptions in Python has the same names).
#pragma once

namespace bt {

enum class Integrator { implicit_euler, bdf2, explicit_euler };
enum class Iteration { newton, single };
enum class LinearSolver { banded, pcg };
enum class BoneContact { spring, constraint };

inline bool is_second_order(Integrator method) { return method == Integrator::bdf2; }

struct Options {
  Integrator integrator = Integrator::implicit_euler;
  Iteration iteration = Iteration::newton;
  LinearSolver linear_solver = LinearSolver::banded;
  BoneContact bone_contact = BoneContact::spring;
  double tolerance = 1e-8;  // residual force over the largest force [-]
  int max_iterations = 100;
  double linear_tolerance = 1e-10;  // of conjugate gradients, preconditioned residual [-]
  double contact_stiffness = 0;     // [N/m]; 0: chosen per contact, with multipliers
  double contact_threshold = 0;     // d_collision beyond the surfaces [m]
  double reuse_tolerance = 1e-6;    // error allowed to a reused contact plane [m]
  bool sleep = true;                // tendons at rest sleep
  long max_linear_solves = 8000;    // per step, of all islands together
  double time_budget = 0;           // wall time per step [s]; 0: unlimited
};

// Whether steps are solved to convergence, with multipliers that are carried from step to step.
inline bool carries(const Options& o) {
  return o.iteration == Iteration::newton && o.integrator != Integrator::explicit_euler;
}

}  // namespace bt
