// The bending energy of a tendon: one element at every inner particle, and one at a clamped end.
#pragma once
#include "bending.h"
#include "chain.h"

namespace bt {

bool bends(const Chain& c);
double bending_energy(const Chain& c, const Field& x);
// residual += gradient at x.
void add_bending_forces(Chain& c, const Field& x);
// matrix += Hessian at x; definite: without what can be negative.
void add_bending_blocks(Chain& c, const Field& x, bool definite);
// Force on particle i at x after the displacements u, by the (definite) linearisation at x.
Vec3 bending_force_after(const Chain& c, const Field& x, const Field& u, int i);

}  // namespace bt
