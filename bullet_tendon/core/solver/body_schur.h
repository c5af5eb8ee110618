// The unknowns of bodies in an island's solution (solver/body_schur.cpp), and the elements between them.
#pragma once
#include <cstddef>

#include "integrator/substepper.h"
#include "solver/island.h"

namespace bt {

// Sets the first guess of the unknowns y, and places the carried particles accordingly.
void start_bodies(Island& island);
// Sets dy = y, and y = 0.
void put_bodies_aside(Island& island);
// Places the particles that bodies carry, by y.
void place_bodies(Island& island);
// Sum of |y|^2/2 [J].
double body_potential(const Island& island);
// Sets the wrenches that are missing from the forces of the iterate to move bodies by y (Link::correction).
void correct_wrenches(Island& island);
// Whether the normal forces of contacts on a body that moves, without signs, are more than `ratio` times what
// contacts move it by: friction or other contacts hold them, and any force is in equilibrium.
bool contacts_lock_bodies(const Island& island, double ratio);
// Adds alpha dy + second correction to y.
void advance_bodies(Island& island, double alpha, double second = 0);
// The bodies' part of r.(d + second c), with the step d and its correction c.
double body_slope(const Island& island, double second);
// Sets dy, or another change of y, to share * corner_side, and x to the resulting displacements of the
// carried particles.
void move_bodies(Island& island, double share, Which x,
                 dense::Numbers BodyUnknowns::* change = &BodyUnknowns::dy);
// Add loads to the links: the force [N] of a contact, and the forces on carried particles.
void load_body(Island& island, const Contact& contact, Vec3 force);
void load_carried(Island& island, Which forces);
// The same of the forces of lines, or (beyond) of what those of the linearisation exceed them by.
void load_lines(Island& island, bool beyond);
// Clear the loads of the links. The residual of the unknowns is `share` times y, or (add_body_residual) its
// present value, plus the loads added since then.
void clear_loads(Island& island);
void clear_pulls(Island& island);  // the sums from which the stiffness of large rotations is computed
void start_body_residual(Island& island, double share);
void add_body_residual(Island& island);
// Whether the forces of the step up to the end of this substep, with the iterate's, overpower what holds a
// body.
bool bodies_are_overpowered(const Island& island, const Substepper& substeps);
// Largest residual of a body, as a force at its most mobile touched point [N].
double body_residual(const Island& island);
// Assembles the border and the corner of the matrix, before anchors are removed from the tendons' part.
// definite: the terms of large rotations are positive semidefinite.
void make_border(Island& island, bool definite);
// Copies one column of panel p (number `lane`) to tendon.column, and A^-1 times it from tendon.solved to the
// panel.
void take_column(Island& island, size_t p, int lane);
void put_answer(Island& island, size_t p, int lane);
// corner -= C^T A^-1 C, with columns of panel p and rows of panel q; and corner_side -= C^T x.
void take_complement(Island& island, size_t p, size_t q);
void take_steps(Island& island, size_t p, Which x);
// tendon.column = b - C corner_side, the right-hand side of the tendons for known body unknowns.
void answer_bodies(Island& island, Which b);
// Displacement [m] of the body at a contact, from where it is foreseen to be, or (by_step) by the step of its
// unknowns.
Vec3 body_moved(const Island& island, const Contact& contact, bool by_step);

// Displacement of the point of a line on its body by the step of the unknowns [m].
Vec3 end_moved(const Island& island, const Anchor& line);

// Elements between bodies (solver/element_coupling.cpp).

// Computes where the links of the elements end, and evaluates the elements there.
void evaluate_elements(IslandElements& elements, const std::vector<Link>& links);
// Adds the gradient of the elements' potential to the loads of the links. Returns their largest force [N].
double load_elements(Island& island);
// Computes the elements' `curvature` at the last evaluation.
void find_curvature(IslandElements& elements);
// Adds the second derivatives of the potential to the corner of the matrix. definite: it stays definite.
void stiffen_by_elements(Island& island, bool definite);
// Sum of the potentials at the last evaluation [J].
double element_potential(const Island& island);
// Force of one rounding of the links' places, largest of the elements [N].
double element_rounding(const Island& island);

}  // namespace bt
