// Bending stiffness: a discrete curvature energy between neighbouring segments, without twist. With the
// segments e, f of rest lengths l_e, l_f, and l the mean of both,
//
//   kappa = |f/l_f - e/l_e| / l,   E = EI l kappa^2 / 2.
//
// It is quadratic in the positions (Bergou et al. 2006, "A quadratic bending model for inextensible
// surfaces"), and where segments have their rest lengths, kappa = 2 sin(theta/2)/l with theta the angle
// between them. Its Hessian is constant and never negative. An energy of the angle alone would have no such
// bound at a fold, and none where a segment that carries no compression gets short. Per material length,
// kappa includes the stretch: at a strain s the bending stiffness is EI (1 + s)^2.
//
// A clamp fixes the direction t of an end: f/l_f - t, or t - e/l_e, with l half the rest length of the end
// segment, so that the moment of the end acts over its own half segment (second order in the spacing).
#pragma once
#include "tendon/tendon.h"

namespace bt {

// The bending energy of a tendon: one element at every inner particle, and one at a clamped end.

double bending_energy(const Tendon& c, const Field& x);
// residual += gradient at x.
void add_bending_forces(Tendon& c, const Field& x);
// matrix += Hessian.
void add_bending_blocks(Tendon& c);
// Force on particle i [N] at the positions x + u.
Vec3 bending_force(const Tendon& c, const Field& x, const Field& u, int i);

}  // namespace bt
