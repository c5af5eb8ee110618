// Bending stiffness: a discrete curvature energy between neighbouring segments (Bergou et al. 2008,
// "Discrete elastic rods", without twist). With segments e, f, their unit vectors t, u and c = t.u,
//
//   kappa = 2 tan(theta/2),   E = EI kappa^2 / (2 l) = k (1 - c)/(1 + c),   k = 2 EI / l,
//
// l the mean of the two rest lengths. Gradient and Hessian follow from
//
//   p = dc/de = (u - c t)/|e|,     q = dc/df = (t - c u)/|f|,
//   E' = -2 k/(1 + c)^2,           E'' = 4 k/(1 + c)^3.
//
// A clamp fixes the direction of an end. There e is a given direction and l is half a rest length, so that
// the moment of the end acts over its own half segment (second order in the spacing).
#pragma once
#include "tendon/tendon.h"

namespace bt {

struct Mat3 {
  double m[9] = {};  // row-major
};

struct Bend {
  double energy = 0;   // E [J]
  Vec3 de, df;         // dE/de, dE/df [N]
  Mat3 dee, dff, dfe;  // second derivatives [N/m]; dfe: rows f, columns e
};

// k [J]. definite: omits the part of the Hessian that can be negative.
Bend bend(Vec3 e, Vec3 f, double k, bool hessian, bool definite);

// Smallest 1 + c at which the energy is evaluated [-]; below it the energy continues along its tangent. A
// fold (1 + c = 0) has infinite curvature energy, and a finite step must be able to leave it.
constexpr double kSharpest = 1e-3;

// The bending energy of a tendon: one element at every inner particle, and one at a clamped end.

bool bends(const Tendon& c);
double bending_energy(const Tendon& c, const Field& x);
// residual += gradient at x.
void add_bending_forces(Tendon& c, const Field& x);
// matrix += Hessian at x; definite: omits the part that can be negative.
void add_bending_blocks(Tendon& c, const Field& x, bool definite);
// Force on particle i [N] after the displacements u from x, by the definite linearisation at x.
Vec3 bending_force_after(const Tendon& c, const Field& x, const Field& u, int i);

}  // namespace bt
