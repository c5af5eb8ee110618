// Linear solutions of an island.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// A step = -residual with all holds applied: banded, or sparse where tendons touch, or by preconditioned
// conjugate gradients; and with the unknowns of bodies. definite: it was assembled to be positive definite.
// false: it is not.
bool solve_linear(Island& island, const StepContext& context, bool definite);

// y = alpha x + beta y, of every tendon.
void combine(Island& island, double alpha, Which x, double beta, Which y);
// x = A^-1 b of the tendons, by the factors of the last solution. false: a direction of no curvature was met.
bool apply_inverse(Island& island, const Options& o, Which b, Which x);
// The same with the bodies, whose right-hand side is their residual, and their part of x in corner_side.
bool solve_again(Island& island, const Options& o, Which b, Which x);

// The sparse one: its factors, and x = A^-1 b.
bool factorise_coupled(Island& island);
void solve_coupled(Island& island, Which b, Which x);

// cg_image = A cg_direction; and the part of that which contacts between tendons have beside the bands.
void multiply(Island& island);
void add_coupling(Island& island);

}  // namespace bt
