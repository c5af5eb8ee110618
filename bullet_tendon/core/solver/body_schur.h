// The unknowns of bodies in an island's solution (body_schur.cpp).
#pragma once
#include <cstddef>

#include "solver/island.h"

namespace bt {

// Bodies that are unknown (solver/body_schur.cpp). Their first guess, and where they take tendons by y:
void start_bodies(Island& island);
void forget_bodies(Island& island);  // y = 0
void advance_bodies(Island& island, double alpha);
// Their part of r.d, the slope along the direction.
double body_slope(const Island& island);
// The step of the unknowns, a share of corner_side, and where it takes the particles, in x.
void move_bodies(Island& island, double share, Which x);
// Forces on them: of a contact, more than those known before; and those on the particles they carry.
void load_body(Island& island, const Contact& contact, Vec3 force);
void load_carried(Island& island, Which forces);
// Residual, from the loads since they were cleared; added to a share of the unknowns, or to what there is.
void clear_loads(Island& island);
void clear_pulls(Island& island);  // what turns the arms of loads
void start_body_residual(Island& island, double share);
void add_body_residual(Island& island);
// Largest residual, as a force at the point of theirs that yields most [N].
double body_residual(const Island& island);
// Their part of the matrix, before holds are taken out of the tendons' part (solver/body_schur.cpp).
void make_border(Island& island, bool definite);
// Of panel p (solver/body_schur.cpp): a column of it to tendon.column, and its answer from tendon.solved.
void take_column(Island& island, size_t p, int lane);
void put_answer(Island& island, size_t p, int lane);
// corner -= C^T A^-1 C, of the columns of panel p and the rows of panel q; and corner_side -= C^T x.
void take_complement(Island& island, size_t p, size_t q);
void take_steps(Island& island, size_t p, Which x);
// tendon.column = b - C corner_side: what the bodies' step leaves for the tendons.
void answer_bodies(Island& island, Which b);
Vec3 body_moved(const Island& island, const Contact& contact, bool by_step);

}  // namespace bt
