// The residual and the matrix that Newton's method needs (newton.cpp).
#pragma once
#include "stepping.h"

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

// Ways to go on (safeguard.cpp): by that share of the step.
void advance(Group& group, double alpha);
// Half the step: sets of contacts that follow each other in a circle, or get nowhere, are left by that.
void halve_step(Group& group);
// Along a direction of descent, to where the slope of the step's potential has at least halved.
void line_search(Group& group);
// From the state that is known to be finite.
void restart_from_now(Group& group);

}  // namespace bt
