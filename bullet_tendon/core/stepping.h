// Time stepping (paper, section 4.2): one step of a group of tendons that touch each other.
//
// With b the step weight and history positions and velocities xh, vh,
//
//   implicit Euler   b = dt,       xh = x_0,                vh = v_0
//   BDF2             b = 2 dt/3,   xh = (4 x_0 - x_-1)/3,   vh = (4 v_0 - v_-1)/3
//     after a step of another length, dt/w:
//                    b = (1 + w)/(1 + 2 w) dt,   xh = x_0 + w^2/(1 + 2 w) (x_0 - x_-1),   vh likewise
//
// the end of the step solves (7), written for positions, with y = xh + b vh + b^2 M^-1 f_ext:
//
//   r(x) = M (x - y) / b^2 - f(x, (x - xh)/b) = 0,     v = (x - xh)/b.
//
// Newton's matrix is M/b^2 + sum of spring blocks (springs.h) + contact blocks (row.h).
#pragma once
#include <memory>
#include <vector>

#include "link.h"
#include "options.h"
#include "row.h"
#include "sparse.h"
#include "substepper.h"

namespace bt {

struct StepContext {
  double dt = 0;
  double reach = 0;        // s of mover.h [s]
  bool may_halve = false;  // a solution that does not converge is given up, and the substep cut
  Budget* budget = nullptr;
  bool whole = false;     // the step's length means nothing: it is a way to rest
  bool part = false;      // of a step: what touches something takes it by implicit Euler
  bool goes_on = false;   // from the last solution, with more rows
  bool may_look = false;  // for rows where particles stray: solutions are left for that before they are exact
  Vec3 gravity;
  Options options;
};

// Two points that act on each other: by a spring, or by a contact, of a tendon (b.chain = -1: with a link).
struct Push {
  Spot a, b;
  Vec3 along;       // unit, from b to a
  Vec3 of_link;     // velocity of the link there [m/s]
  double made = 0;  // energy that it made out of nothing [J]
  Row* row = nullptr;
  double light = 0;  // inverse mass that an impulse between them meets [1/kg]
};

// Tendons joined by tendon-tendon contacts, with the rows that touch them.
struct Group {
  const std::vector<Chain*>* slots = nullptr;  // all tendons of the world, as spots name them
  std::vector<Chain*> chains;
  std::vector<int> numbers;  // of their slots
  std::vector<Row*> rows;
  // Bodies that are unknown, the links of them that are touched, and how many unknowns that makes
  // (border.cpp).
  std::vector<Mover>* movers = nullptr;
  std::vector<Link>* links = nullptr;
  std::vector<int> bodies, carried;
  int freedom = 0;
  double reach = 0;        // s of mover.h [s]
  std::vector<Row> extra;  // found while solving; kMostExtraRows at most, so that pointers stay
  bool coupled = false;    // some row joins two tendons, or two places of one
  // Of the matrix of tendons that touch each other (coupled.cpp): the factors and the pattern, where each
  // tendon's particles begin, by slot, and by block what holds leave free and the right-hand side.
  SparseFactor factor;
  SparseFactor::Edges edges;
  std::vector<int> offset;
  bool patterned = false;    // the pattern is of this group
  std::vector<Row*> acting;  // in the matrix that is being made
  bool follows = true;       // points of rows move along with what they touch,
  double most_jump = 0;      // but for pairs whose force that would change by more than this [N],
  bool stayed = false;       // of which there are some that have not been looked at
  std::vector<Sym3> free;
  std::vector<Vec3> right_hand;
  int iterations = 0;
  double residual = 0;  // largest residual force over the largest force at hand
  bool converged = false;
  bool strays = false;  // left, for that
  bool finite = true;
  double linear_tolerance = 0;  // that this solution can make use of; 0: that of the options
  // By unknown of the bodies: what they pull at the tendons, by tendon, where in the group that is, by slot,
  // and what they make of links (columns.cpp); the matrix and right-hand side of the rest.
  std::vector<Border> borders;
  std::vector<int> place_of;
  std::vector<LinkColumns> of_links;
  dense::Numbers corner, corner_root, corner_side;

  std::vector<Push> pushes;  // of passivity.cpp

  Chain& at(const Spot& s) const { return *(*slots)[s.chain]; }
};

// History, goal y, starting guess and held particles of a chain.
void begin_step(Chain& c, const StepContext& context);
// One step by the method of the options; fills chain.next and the forces of holds and rows.
void solve(Group& group, const StepContext& context);
// Whether two-step methods may go on with what touches something, after its step of dt; acceleration is that
// of the step before (restarts.cpp).
bool goes_smoothly(const Chain& c, double dt);
// Takes chain.next as the new state.
void finish_step(Chain& c, const StepContext& context);

// Implicit, converged.
void converged_step(Group& group, const StepContext& context);
// Takes energy that a solution made out of nothing from its velocities.
void keep_passive(Group& group);
// One Newton solution at chain.next; the safeguard is used only if asked for.
void newton(Group& group, const StepContext& context, bool safeguarded);
void single_linearisation(Group& group, const StepContext& context);  // implicit, as published
void explicit_euler(Group& group, const StepContext& context);

// Contacts that the solution leaves nearer than their rows meant, because their nearest points have
// moved along, get one more row each beside the first (which holds what it held). true: some did.
bool add_missed(Group& group);

// A step = -residual with all holds applied: banded, or sparse where tendons touch, or by preconditioned
// conjugate gradients; and with the unknowns of bodies. definite: it was assembled to be positive definite.
// false: it is not.
bool solve_linear(Group& group, const StepContext& context, bool definite);
using Which = Field Chain::*;
// y = alpha x + beta y, of every tendon.
void combine(Group& group, double alpha, Which x, double beta, Which y);
// x = A^-1 b of the tendons, by the factors of the last solution. false: a direction of no curvature was met.
bool apply_inverse(Group& group, const Options& o, Which b, Which x);
// The same with the bodies, whose right-hand side is their residual, and their part of x in corner_side.
bool solve_again(Group& group, const Options& o, Which b, Which x);
// What friction limits that go with the step make of chain.step, where they change by more than `enough` [N]
// (limits.cpp).
void solve_limits(Group& group, const StepContext& context, double enough);
// The sparse one: its factors, and x = A^-1 b.
bool factorise_coupled(Group& group);
void solve_coupled(Group& group, Which b, Which x);

// Bodies that are unknown (border.cpp). Their first guess, and where they take tendons by y:
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
// Their part of the matrix, before holds are taken out of the tendons' part (columns.cpp).
void make_border(Group& group, bool definite);
// Of panel p (complement.cpp): a column of it to chain.column, and its answer from chain.solved.
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

// The rows that act now, for the matrix.
void find_acting(Group& group);
// cg_image = A cg_direction; and the part of that which rows between tendons have beside the bands.
void multiply(Group& group);
void add_coupling(Group& group);

// After chain.step was added to chain.next: without what segments got longer by turning (turning.cpp).
void keep_lengths(Chain& c);

// Greatest sine of the angle by which a segment turns from chain.x to the guess in chain.next; what is turned
// over along itself does not count.
double greatest_turn(const Chain& c);

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
