// The residual and the matrix that Newton's method needs (solver/newton.cpp).
#pragma once
#include "solver/island.h"

namespace bt {

struct Assembly {
  double scale = 0;      // largest force at hand [N]
  double residual = 0;   // largest residual force [N]
  double of_bodies = 0;  // largest of theirs
  double of_limits = 0;  // largest difference of a friction limit from mu N
};

// A contact that constrains its particle directly: it starts to hold when the particle is inside, and lets go
// when it would have to pull. true: it has changed.
bool update_direct(Island& island, Contact& contact);
// True residual of the island at tendon.x_new; what holds supply is still in it.
Assembly residual_of(Island& island, bool definite, bool at_position = false);
// Its norms, once what holds supply has been taken out.
void measure_residual(Island& island, Assembly& a);
// The contacts' multipliers and friction limits from the step, before it is taken.
void predict_contacts(Island& island);
// The springs' multipliers go along with the step: the forces that the linearisation foresees.
void carry_springs(Island& island);
// Residual over the force of one rounding, largest of the tendons [-]: of the displacements, or (at_guess) of
// the positions at the start of the step.
double in_roundings(Island& island, const Assembly& a, bool at_guess);
// The matrix, and the residual of the linearisation in place of the true one. definite_rows: the contacts'
// blocks alone.
void assemble(Island& island, Linearisation how, bool definite, bool definite_contacts);
// The particle of every tendon with the largest residual.
void find_worst(Island& island);

// The contacts that act now, for the matrix.
void find_acting(Island& island);

// Pieces that the methods share.
Vec3 relative_position(const Island& island, const Contact& contact, Field Tendon::* where);
void add_contact_force(Island& island, const Contact& contact);
// The points of a contact that are nearest now, where they move along; and the rest of its block, before
// add_row_block.
void follow(Island& island, Contact& contact);
void add_sliding_blocks(Island& island, Contact& contact, bool definite);
void add_contact_block(Island& island, const Contact& contact);
// What the contact's linearisation adds to its true force, into the residual.
void add_contact_linearisation(Island& island, const Contact& contact);
// Forces into the residual, or (matrix) stiffnesses into the matrix.
void add_soft_anchors(Tendon& c, const Field& x, bool matrix);
// Removes what holds take up from `what` (a residual or a direction).
void project_anchors(Island& island, Field Tendon::* what);
// The same for the matrices.
void fix_in_matrix(Island& island);
// Whether a rigid hold contradicts a contact against a body, which then has no solution: the hold wins.
bool overruled(const Contact& contact, const Tendon& c);
// Force of the tendon on each holder, from residuals that holds have not been removed from yet.
void read_anchor_forces(Tendon& c);

}  // namespace bt
