// The springs of a tendon: structure springs join (i, i+1), shear springs join (i, i+2).
//
// Within a step the force of a spring is a function of its length alone (axial damping included),
//
//   F(len) = K f(len/l - 1) + C d((len - len_h)/(b l)),
//
// with len_h the history length and b the step weight of the integrator (integrator/scheme.h), so that it
// has a potential, is exactly axial, and brakes no rigid rotation. Its matrix block is
//
//   B = F' n n^T + (T/len) (I - n n^T),     n = x_ij / |x_ij|,
//
// where T is the carried multiplier: the force that the last iteration predicted linearly, kept from
// step to step. Where that makes the matrix indefinite (a compressed tendon that buckles), negative
// T/len are cut off at what inertia outweighs. Taking T from the current positions instead makes B wild,
// because an error of a micrometre is newtons.
//
// The elastic law is linearised where the multiplier says that the spring is, at the strain s* with
// K f(s*) = T_e (T_e the elastic part of T), not where the positions happen to be: that is
// Newton's method for forces and positions as independent unknowns (mixed). A stiffening law
// linearised at a strain that is too small sends the positions far away in one iteration, but
// predicts the right force; the next iteration, linearised there, brings the positions home.
// The residual is always measured with the true force F; `linear` is the force that the
// linearisation gives at the present length.
#pragma once
#include <vector>

#include "linear/block_band_ldlt.h"
#include "tendon/axial_law.h"

namespace bt {

// A direction cannot be taken from a spring shorter than this share of its rest length [-].
// Larger: a collapsed tendon loses forces. Smaller: the direction is rounding noise.
constexpr double kDegenerateLength = 1e-9;

// Strain at which the material's tangent is taken for the contact stiffness of a slack tendon [-].
// A power law has no stiffness at rest, and a contact must be stiff before the load comes.
constexpr double kReferenceStrain = 0.01;

// What of springs a step leaves to the next one.
struct SpringState {
  std::vector<double> lambda;   // T [N]
  std::vector<double> elastic;  // T_e [N]
  std::vector<double> slope;    // F' at the linearisation [N/m]; contacts take their stiffness from it
};

struct SpringSet : SpringState {
  int reach = 1;  // joins particle k with k + reach
  int count = 0;
  // From the tendon's rest lengths, masses and material (Tendon::set_rest).
  std::vector<double> rest, stiffness, damping;  // l [m], K [N], C [N s^q]
  std::vector<double> inverse_rest;              // [1/m]
  std::vector<double> lighter;                   // smaller mass of its two particles [kg]
  bool damped = false;                           // some C is not 0
  // Of damped springs, in this step: lengths at its start, and len_h [m].
  std::vector<double> start, history;
  // As last evaluated or linearised.
  std::vector<double> length, force;         // len [m], F [N]
  std::vector<double> true_elastic, linear;  // elastic part of F, and of its linearisation [N]
  std::vector<double> elastic_slope;         // its elastic part of F' [N/m]
  std::vector<double> damping_slope;         // and its damping part [N/m]
  std::vector<double> stiffness_now;         // all of F' and |F|/l, at the present state [N/m]
  Planes direction;                          // n
  Planes block;                              // B, symmetric, six planes
  Planes vector;                             // force vector on the first particle

  void resize(int reach_, int particles);
};

enum class Linearisation {
  multiplier,  // at the strains and forces of the multipliers (mixed Newton)
  position,    // at the present positions (plain Newton, true multipliers)
};

// A step of the integrator. The unknown of a step is the displacement from its start: differences of
// displacements are more exact than differences of positions, whose rounding alone makes forces of K eps
// |x|/l.
struct Motion {
  const Field &x, &displacement;  // at the start of the step, and since then
  const Field& x_before;          // one step before the start
  double history;                 // xh = x + history (x_before - x)
  double h_eff;                   // b [s]

  // At the end of the step: (x + displacement - xh)/b.
  Vec3 velocity(int i) const {
    return (1 / h_eff) * (displacement.at(i) - history * (x_before.at(i) - x.at(i)));
  }
};

// Lengths and directions at x, or at x + displacement.
void measure(SpringSet& s, const Field& x);
void measure(SpringSet& s, const Field& x, const Field& displacement);
// True forces at the end of the step, with its rates: (len - len_h)/(b l), or the velocities where the
// damping takes the whole velocity. Returns the largest |F| [N].
double evaluate(SpringSet& s, const Law& law, const Motion& motion);
// Slopes, forces of the linearisation and blocks, after evaluate. A spring whose multiplier is below
// floor_force [N] keeps its true force, and a slope of at least the one at that force: it costs
// nothing where forces are larger, and couples a slack tendon at once. definite: compressed springs are
// cut off at what inertia outweighs; else they enter in full.
void linearise(SpringSet& s, const Law& law, Linearisation how, double floor_force, const Motion& motion,
               bool definite);
// Both, at a state (x, v) that need not satisfy v = (x - xh)/b: explicit Euler and the single
// linearisation. Damping forces enter the force vector times damping_share, the slopes in full.
void evaluate_at(SpringSet& s, const Law& law, const Field& x, const Field& v, double dt,
                 double damping_share);

// right_hand += what the linearisation adds to the true forces; nothing where they agree.
void scatter_linearisation(const SpringSet& s, const Law& law, Field& right_hand);
// residual -= spring forces.
void scatter_forces(const SpringSet& s, Field& residual);
// matrix = inverse M + the blocks of structure and shear springs, inverse = 1/b^2.
void start_matrix(const SpringSet& structure, const SpringSet& shear, const std::vector<double>& mass,
                  double inverse, Band& matrix);
// matrix += blocks; the blocks of shear springs beside the diagonal are the first that come there.
void scatter_blocks(const SpringSet& s, Band& matrix);
// T_e and T after the displacements dx, as the linearisation predicts them.
void carry(SpringSet& s, const Law& law, const Field& dx);
// Largest stiffness at the present state, along and across a spring [N/m].
double largest_stiffness(SpringSet& s, const Law& law, double b);
// Elastic energy [J] at the lengths last measured; of spring k at a length.
double stored_energy(const SpringSet& s, const Law& law);
double stored_energy(const SpringSet& s, const Law& law, int k, double length);

// What springs carry over from one step to the next.
struct Multipliers {
  std::vector<double> lambda[2], elastic[2];  // of structure and shear springs [N]
};

}  // namespace bt
