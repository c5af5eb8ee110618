// The residual and the matrix that Newton's method needs (solver/newton.cpp).
#pragma once
#include "solver/island.h"

namespace bt {

struct Assembly {
  double scale = 0;      // largest force at hand [N]
  double residual = 0;   // largest residual force [N]
  double of_bodies = 0;  // largest of theirs
};

// A row that constrains its particle directly: it starts to hold when the particle is inside, and lets go
// when it would have to pull. true: it has changed.
bool update_direct(Group& group, Row& row);
// A row at chain.next, its points where they are nearest. at_position: judged by where it is, not by what was
// foreseen.
void evaluate(Group& group, Row& row, bool at_position, bool definite);
// True residual of the group at chain.next; what holds supply is still in it.
Assembly residual_of(Group& group, bool at_position, bool definite);
// Its norms, once what holds supply has been taken out.
void measure_residual(Group& group, Assembly& a);
// The rows' multipliers from the step, before it is taken.
void foresee_contacts(Group& group);
// The springs' multipliers go along with the step: the forces that the linearisation foresees.
void carry_springs(Group& group);
// Residual over the force of one rounding, largest of the chains [-]. tails: positions have theirs.
double in_roundings(Group& group, const Assembly& a, bool tails);
// The matrix, and the residual of the linearisation in place of the true one. definite_rows: the rows' blocks
// alone.
void assemble(Group& group, Linearisation how, bool definite, bool definite_rows);
// The particle of every tendon with the largest residual.
void find_worst(Group& group);

// The rows that act now, for the matrix.
void find_acting(Group& group);

// Pieces that the methods share.
Vec3 relative_position(const Group& group, const Row& row, Field Chain::* where);
void add_row_force(Group& group, const Row& row);
// The points of a row that are nearest now, where they move along; and the rest of its block, before
// add_row_block.
void follow(Group& group, Row& row);
void add_lever_blocks(Group& group, Row& row, bool definite);
void add_row_block(Group& group, const Row& row);
// What the row's linearisation adds to its true force, into the residual.
void add_row_linearisation(Group& group, const Row& row);
// Forces into the residual, or (matrix) stiffnesses into the matrix.
void add_soft_holds(Chain& c, const Field& x, bool matrix);
// Removes what holds take up from `what` (a residual or a direction).
void project_holds(Group& group, Field Chain::* what);
// The same for the matrices.
void hold_in_matrix(Group& group);
// Whether a rigid hold contradicts a row against a body, which then has no solution: the hold wins.
bool overruled(const Row& row, const Chain& c);
// Force of the tendon on each holder, from residuals that holds have not been removed from yet.
void read_holds(Chain& c);

}  // namespace bt
