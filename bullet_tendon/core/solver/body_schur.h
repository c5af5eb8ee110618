// The unknowns of bodies in an island's solution (body_schur.cpp).
#pragma once
#include <cstddef>

#include "solver/island.h"

namespace bt {

// Bodies that are unknown (solver/body_schur.cpp). Their first guess, and where they take tendons by y:
void start_bodies(Group& group);
void forget_bodies(Group& group);  // y = 0
void advance_bodies(Group& group, double alpha);
// The step of the unknowns, a share of corner_side, and where it takes the particles, in x.
void move_bodies(Group& group, double share, Which x);
// Forces on them: of a row, more than those known before; and those on the particles they carry.
void load_body(Group& group, const Row& row, Vec3 force);
void load_carried(Group& group, Which forces);
// Residual, from the loads since they were cleared; added to a share of the unknowns, or to what there is.
void clear_loads(Group& group);
void clear_pulls(Group& group);  // what turns the arms of loads
void start_body_residual(Group& group, double share);
void add_body_residual(Group& group);
// Largest residual, as a force at the point of theirs that yields most [N].
double body_residual(const Group& group);
double body_slope(const Group& group);
// Their part of the matrix, before holds are taken out of the tendons' part (solver/body_schur.cpp).
void make_border(Group& group, bool definite);
// Of panel p (solver/body_schur.cpp): a column of it to chain.column, and its answer from chain.solved.
void take_column(Group& group, size_t p, int lane);
void put_answer(Group& group, size_t p, int lane);
// corner -= C^T A^-1 C, of the columns of panel p and the rows of panel q; and corner_side -= C^T x.
void take_complement(Group& group, size_t p, size_t q);
void take_steps(Group& group, size_t p, Which x);
// chain.column = b - C corner_side: what the bodies' step leaves for the tendons.
void answer_bodies(Group& group, Which b);
// Torque of a force at an attachment, as the solution turns the body.
Vec3 torque_of(const Group& group, const Hold& h, Vec3 force);
Vec3 body_moved(const Group& group, const Row& row, bool by_step);

}  // namespace bt
