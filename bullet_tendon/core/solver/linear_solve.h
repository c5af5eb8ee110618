// Linear solutions of an island.
#pragma once
#include "integrator/scheme.h"
#include "solver/island.h"

namespace bt {

// Solves A step = -residual, with all anchors applied and with the unknowns of bodies. A is banded, or sparse
// where tendons touch. Alternatively it uses preconditioned conjugate gradients. definite: the matrix was
// assembled to be positive definite. false: the matrix is not positive definite.
bool solve_linear(Island& island, const StepContext& context, bool definite);

// y = alpha x + beta y, for every tendon.
void combine(Island& island, double alpha, Which x, double beta, Which y);
// x = A^-1 b of the tendons, by the factors of the last solution. false: conjugate gradients met a direction
// without positive curvature.
bool apply_inverse(Island& island, const Options& o, Which b, Which x);
// The same with the bodies. Their right-hand side is their residual, and corner_side receives their part of
// x.
bool solve_again(Island& island, const Options& o, Which b, Which x);

// The sparse matrix of tendons in contact: factorisation, and x = A^-1 b.
bool factorise_coupled(Island& island);
void solve_coupled(Island& island, Which b, Which x);

// cg_image = A cg_direction. add_coupling adds the blocks of contacts between tendons, outside the bands.
void multiply(Island& island);
void add_coupling(Island& island);

}  // namespace bt
