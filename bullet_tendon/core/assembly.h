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
// True residual of the group at chain.next; what holds supply is still in it. at_position: contacts are
// judged by where they are, not by what was foreseen.
Assembly residual_of(Group& group, bool at_position, bool definite);
// Its norms, once what holds supply has been taken out.
void measure_residual(Group& group, Assembly& a);
// Residual over the rounding of one coordinate, largest of the chains [-].
double in_roundings(Group& group, const Assembly& a);
// The matrix, and the residual of the linearisation in place of the true one. definite_rows: the rows' blocks
// alone.
void assemble(Group& group, Linearisation how, bool definite, bool definite_rows);
// The particle of every tendon with the largest residual.
void find_worst(Group& group);

}  // namespace bt
