// The solution of one island.
//
// `solve` is the entry (solver/island_step.cpp). It selects the method by the options:
//
//   converged_step         Newton's method to the tolerance (solver/newton.cpp), then the velocities, and the
//                          removal of the energy that the step created (solver/energy_projection.cpp)
//   single_linearisation   one linearisation of implicit Euler (solver/published_methods.cpp)
//   explicit_euler         no linear system (solver/published_methods.cpp)
//
// Newton's method repeats: residual_of, update_direct, measure_residual and assemble (solver/assembly.h);
// solve_linear, for tendon.dx and dy of the bodies (solver/linear_solve.cpp, solver/body_schur.h);
// solve_limits, which corrects them (solver/friction_limits.cpp).
//
// Before: begin_step (integrator/scheme.h) has computed h_eff, the inertial target and the guess tendon.x_new
// of every tendon, and rigid anchors are placed. The contacts have their geometry and their multipliers.
// After: tendon.x_new, tendon.v_new, the multipliers, the forces of anchors and contacts, and island.result
// are those of the solution. tendon.x and tendon.v are unchanged: the Substepper decides whether the solution
// becomes the state.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// One substep by the method of the options.
void solve(Island& island, const StepContext& context);

// Whether a particle is outside its predicted region.
bool leaves_predicted_region(const Island& island);
void converged_step(Island& island, const StepContext& context);
void single_linearisation(Island& island, const StepContext& context);
void explicit_euler(Island& island, const StepContext& context);

// Solves A step = -residual, with all anchors applied and with the unknowns of bodies. A is banded, or sparse
// where tendons touch. Alternatively it uses preconditioned conjugate gradients. definite: the matrix was
// assembled to be positive definite. false: the matrix is not positive definite. indefinite_too: the tendons'
// part of it need not be, if factors solve.
bool solve_linear(Island& island, const StepContext& context, bool definite, bool indefinite_too = false);
// Computes the Schur complement of the tendons (bodies.corner) alone, which need not be definite. false: the
// tendons' matrix is not positive definite.
bool eliminate_tendons(Island& island, const StepContext& context);
// x = -A^-1 C y, the motion of the tendons' particles with the unknowns y of bodies (corner_side). Those that
// bodies carry stay where they are. false: as of solve_again.
bool follow_bodies(Island& island, const StepContext& context, Which x);
// x = A^-1 b by the factors of the last solution, bodies included. Their right-hand side is their residual,
// and corner_side receives their part of x. false: conjugate gradients met a direction without positive
// curvature.
bool solve_again(Island& island, const Options& o, Which b, Which x);
// The same for forces on particles and on links (LinkIterate::load). Anchors take those on the particles they
// hold.
bool answer_forces(Island& island, const Options& o, Which forces, Which x);
// x: a direction in which the matrix of the tendons, factored with `indefinite_too`, has negative curvature
// while bodies do not move. b: forces that choose among these directions. false: there is none, or, with
// conjugate gradients, none was looked for.
bool find_negative_curvature(Island& island, const Options& o, Which b, Which x);
// y = alpha x + beta y, for every tendon.
void combine(Island& island, double alpha, Which x, double beta, Which y);
// cg_image = A cg_direction.
void multiply(Island& island);

// Corrects tendon.dx for friction limits that change with the normal forces of the step. Changes below a
// small share of `enough` [N] are neglected.
void solve_limits(Island& island, const StepContext& context, double enough);

// The arc on which a Newton step moves the iterate (solver/arc.cpp):
//
//   x(alpha) = x + alpha d + alpha^2 c,     0 <= alpha <= 1
//
// d: tendon.dx and dy of the bodies; c: their corrections, zero unless island.curved.

// Computes c from d, by the factors of the last solution. Afterwards the residual of tendons and bodies and
// the steps of links are undefined.
void find_correction(Island& island, const Options& options);

// Moves the iterate from x(from) to x(to), with its bodies and the particles that they carry.
void advance_along_arc(Island& island, double from, double to);

// r . dx/dalpha at the iterate x(alpha): the derivative of the incremental potential along the arc.
double slope_along_arc(const Island& island, double alpha);

// Struts that would buckle (solver/buckling.cpp).

// Whether tendons are compressed so much that the evaluated iterate may be a saddle.
bool has_struts(const Island& island);

// Computes, as tendon.dx, a step along the mode in which struts buckle, by the factors of the last solution.
// Bodies stay. Afterwards the residual is undefined. false: there is none, or it is not finite. The largest
// displacement is a segment.
bool find_buckling_mode(Island& island, const Options& options);

// Bends struts that are straight to the last bit by so little that only instability makes it visible.
void bend_straight_struts(Island& island);

// Removes the energy that a step of implicit Euler created from tendon.v_new.
void project_energy(Island& island, Vec3 gravity);

}  // namespace bt
