// The springs of a tendon: structure springs join (i, i+1), shear springs join (i, i+2).
//
// Within a step the force of a spring is a function of its length alone (axial damping included),
//
//   F(len) = K f(len/l - 1) + C d((len - len_h)/(b l)),
//
// with len_h the history length and b the step weight of the integrator (integrator/scheme.h). Therefore the
// force has a potential, is exactly axial, and does not damp rigid rotation. Its matrix block is
//
//   B = F' n n^T + (T/len) (I - n n^T),     n = x_ij / |x_ij|,
//
// where T is the multiplier: the force that the last iteration predicted linearly. It is kept from step to
// step. A compressed tendon that buckles would make the matrix indefinite. There negative T/len are limited
// to a share of the inertia. With T from the current positions B would change strongly between iterations,
// because an error of a micrometre changes the force by newtons.
//
// The elastic law is linearised at the strain s* of the multiplier, K f(s*) = T_e (T_e the elastic part of
// T), not at the strain of the positions. This is Newton's method with forces and positions as independent
// unknowns (mixed). Where a stiffening law is linearised at too small a strain, one iteration moves the
// positions too far, but predicts the right force. The next iteration is linearised at that force, and
// corrects the positions. The residual is always computed with the true force F. `linear` is the force of
// the linearisation at the current length.
//
// The elastic part may relax (tendon/tissue.h): it is then share K f(len/l - 1) + recalled, and `recalled` is
// treated like the damping.
//
// A tension-only spring carries max(0, F). As with contacts, the multiplier decides whether it is linearised
// as taut: where T > 0, by F without the limit. Where a fast damper holds its force at zero, or a hand that
// stops leaves the guess slack, the force at the current length says nothing about that.
#pragma once
#include <vector>

#include "linear/block_band_ldlt.h"
#include "tendon/axial_law.h"
#include "tendon/tissue.h"

namespace bt {

struct SpringMultipliers {
  std::vector<double> lambda;   // T [N]
  std::vector<double> elastic;  // T_e [N]
};

// The part of springs that one step passes to the next.
struct SpringState : SpringMultipliers {
  std::vector<double> slope;  // F' of the linearisation [N/m]; the contact stiffness follows from it
  // Of springs that relax: T_e at the start of the substep, and the parts m_i of each spring in turn [N].
  std::vector<double> unrelaxed, memory;
};

struct SpringSet : SpringState {
  int reach = 1;  // spring k joins the particles k and k + reach
  int count = 0;
  // Computed from the tendon's rest lengths, masses and material (Tendon::set_rest).
  std::vector<double> rest, stiffness, damping;  // l [m], K [N], C [N s^q]
  std::vector<double> inverse_rest;              // [1/m]
  std::vector<double> lighter;                   // smaller mass of its two particles [kg]
  bool damped = false;                           // some C is not 0
  // Of the substep, where springs relax: T_v = share T_e + recalled.
  double share = 1;
  std::vector<double> recalled;  // [N]
  // Of damped springs: lengths at the start of the substep, and len_h [m].
  std::vector<double> start, history;
  // Results of the last evaluation or linearisation.
  std::vector<double> length, force;                 // len [m], F [N]
  std::vector<double> linear;                        // force of the linearisation [N]
  std::vector<double> true_elastic, linear_elastic;  // elastic parts of F and of `linear` [N]
  std::vector<double> elastic_slope;                 // elastic part of F' [N/m]
  std::vector<double> damping_slope;                 // damping part of F' [N/m]
  // What is not elastic in F, and its part of F', as if it were taut: damping and `recalled` [N], [N/m].
  std::vector<double> braking, braking_slope;
  std::vector<double> stiffness_now;  // F' + |F|/l at the current state [N/m]
  Planes direction;                   // n
  Planes block;                       // B, symmetric, six planes [N/m]
  Planes vector;                      // force vector on the first particle [N]

  void resize(int reach_, int particles);
};

// Makes `s` springs of the rest lengths, the material and the relaxation of others. It keeps its memory. What
// is computed of springs is not copied.
void take_springs(SpringSet& s, const SpringSet& from);

enum class Linearisation {
  multiplier,  // at the strains and forces of the multipliers (mixed Newton)
  position,    // at the current positions, with the true forces as multipliers (plain Newton)
};

// A step of the integrator. Its unknown is the displacement since its start. Differences of displacements
// are more accurate than differences of positions, whose rounding alone causes forces of K eps |x|/l.
struct Motion {
  const Field &x, &displacement;  // positions at the start, and the displacement since then [m]
  const Field& x_before;          // positions one step before the start [m]
  double history;                 // xh = x + history (x_before - x)
  double h_eff;                   // b [s]

  // Velocity at the end of the step, (x + displacement - xh)/b [m/s].
  Vec3 velocity(int i) const {
    return (1 / h_eff) * (displacement.at(i) - history * (x_before.at(i) - x.at(i)));
  }
};

// Computes lengths and directions at x.
void measure(SpringSet& s, const Field& x);
// Computes the true forces along the springs at the end of the step. The damping uses the rates
// (len - len_h)/(b l).
void find_forces(SpringSet& s, const Law& law, const Motion& motion);
// The same with their vectors, in which the damping uses the velocities if `whole_velocity`. Returns the
// largest |F| [N].
double evaluate(SpringSet& s, const Law& law, const Motion& motion);
// Computes slopes, forces of the linearisation and blocks, after `evaluate`. A spring whose multiplier does
// not pull keeps its true force, also as T if that is larger. Its slope is at least the slope at floor_force
// [N], which couples a slack tendon at once; where the true force is above floor_force, it is that of the
// chord between both, by which it unloads at once. A multiplier that pulls is trusted, however small: the
// residual of a guess that stretches stiff or damped springs is far above all forces.
// most_springs: of a particle, 2 or 4; the negative T/len of compressed springs are limited to the share of
// the inertia that keeps the matrix definite. 0: they are not limited.
void linearise(SpringSet& s, const Law& law, Linearisation how, double floor_force, const Motion& motion,
               int most_springs);
// Evaluates and linearises at a state (x, v) that need not satisfy v = (x - xh)/b, for explicit Euler and
// for the paper's single linearisation. Damping forces are scaled by damping_share, their slopes are not.
void evaluate_at(SpringSet& s, const Law& law, const Field& x, const Field& v, double dt,
                 double damping_share);

// right_hand += forces of the linearisation less the true forces.
void scatter_linearisation(const SpringSet& s, const Law& law, Field& right_hand);
// residual -= spring forces.
void scatter_forces(const SpringSet& s, Field& residual);
// matrix = inverse M + the blocks of structure springs, inverse = 1/b^2.
void start_matrix(const SpringSet& structure, const std::vector<double>& mass, double inverse, Band& matrix);
// matrix += blocks.
void scatter_blocks(const SpringSet& s, Band& matrix);
// Sets T_e and T to the forces that the linearisation predicts after the displacements dx.
void carry(SpringSet& s, const Law& law, const Field& dx);
// Sets the forces and their vectors to those of the elongations |d_across|^2/(2 len) that rotation by the
// displacements dx causes, at the slopes of the linearisation (solver/arc.cpp). Returns the largest force
// [N].
double find_curvature_forces(SpringSet& s, const Field& dx);
// Largest sum of axial and transverse stiffness of a spring at the current state [N/m]. b: step weight [s].
double largest_stiffness(SpringSet& s, const Law& law, double b);
// Begins a substep in which springs relax: computes share and recalled.
void begin_relaxation(SpringSet& s, const Relaxation& relaxation);
// Brings the memory to the end of a substep, at the positions x. afresh: the tension there has come at once.
void end_relaxation(SpringSet& s, const Law& law, const Tissue& tissue, const Relaxation& relaxation,
                    const Field& x, bool afresh);

// Potential of the elastic part within the substep [J] of all springs, at the lengths last measured or at
// positions. Without relaxation it is the elastic energy.
double stored_energy(const SpringSet& s, const Law& law);
double stored_energy(const SpringSet& s, const Law& law, const Field& at);

// Elastic energy [J] of spring k, which relaxes, at a given length: that of a spring of g_0 K, and of springs
// of g_i K whose tensions are m_i. For a linear law these are the springs of Maxwell's model.
double maxwell_energy(const SpringSet& s, const Law& law, const Tissue& tissue, int k, double length);

}  // namespace bt
