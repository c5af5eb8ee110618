// The residual and the matrix that Newton's method needs (solver/newton.cpp).
#pragma once
#include "solver/island.h"

namespace bt {

// Largest number of corrections of one kind within a solution [-]: of stiffenings of contacts that press at a
// gap or a depth, and of linear solutions for the friction limits. More: contacts whose depth or limit cannot
// be corrected take iterations. Fewer: multipliers and limits lag behind.
constexpr int kMostCorrections = 8;

struct Assembly {
  double scale = 0;      // largest force of a spring, an anchor, a contact or inertia [N]
  double residual = 0;   // largest residual force [N]
  double of_bodies = 0;  // largest residual force of bodies [N]
  double of_forces = 0;  // largest residual force of particles and bodies [N]
  double of_limits = 0;  // largest difference between a friction limit and mu N [N]
};

// The particle of a direct contact.
int particle_of(const Contact& contact);
// Updates a contact that constrains its particle directly: it becomes active when the particle is inside, and
// inactive when its force would have to pull. Returns whether it has changed.
bool update_direct(Island& island, Contact& contact);
// Computes the true residual of the island at tendon.x_new. It still includes the constraint forces of
// anchors and of direct contacts. at_position: the state of contacts is that at the present positions, not
// the predicted one.
Assembly residual_of(Island& island, bool at_position);
// Removes the constraint forces from the residual and computes its norms.
void measure_residual(Island& island, Assembly& a);
// Predicts the multipliers of the contacts from tendon.dx, before the step is taken, and their friction
// limits, unless it keeps them. far: from the solution, where the residual of a particle that a direct
// contact has just moved is no force of that contact.
void predict_contacts(Island& island, bool keeps_limits, bool far);
// Predicts from tendon.dx which anchors are at the limit of their force.
void predict_anchors(Island& island);
// Updates the multipliers of the springs to the forces that the linearisation predicts for tendon.dx.
void carry_springs(Island& island);
// Residual divided by the force of one rounding, largest of the tendons [-]. The rounding is that of the
// displacements, or (at_guess) of the positions at the start of the step.
double in_roundings(Island& island, const Assembly& a, bool at_guess);
// Assembles the matrix, and replaces the true residual by that of the linearisation. definite: all blocks are
// positive definite. definite_contacts: those of the contacts are.
void assemble(Island& island, Linearisation how, bool definite, bool definite_contacts);
// Sets worst_particle of every tendon: the particle with the largest residual.
void find_worst(Island& island);

// Functions that the converged and the published methods share.
Vec3 relative_position(const Island& island, const Contact& contact, Field Tendon::* where);
// Adds a force that a contact exerts on its point a, and the opposite one on what is there, to a residual and
// to the loads of bodies [N].
void exert(Island& island, const Contact& contact, Vec3 force, Which on);
// Moves the contact points of pairs, mouths and round surfaces to the points that are nearest now.
void follow(Island& island, Contact& contact);
// Lists the contacts that enter the matrix (island.acting), computes their parts of it, and adds what is
// within the bands. slide: with the terms of points that slide; definite: which stay positive definite.
void linearise_contacts(Island& island, bool slide, bool definite);
// The matrix of a linearised contact. link: which moves with the unknowns of its body, else null. turned: the
// segment of the contact [m], if the surface turns with the link in the matrix, else null. all_turn: all
// surfaces do, and their loads have the arms of material points.
void find_matrix(const Contact& contact, const Link* link, const Vec3* turned, bool all_turn,
                 ContactMatrix& k);
// Adds the forces of soft anchors and lines to the residual, or (matrix) their stiffnesses to the matrix and
// the difference between their linearised and their true forces to the residual.
void add_soft_anchors(Tendon& c, const Field& x, bool matrix);
// Removes the components that rigid anchors and direct contacts constrain from a residual or a direction.
void project_anchors(Island& island, Field Tendon::* what);
// Constrains the same components in the matrices.
void fix_in_matrix(Island& island);
// Whether a contact with a body has only anchored particles (or weights of others so small that these would
// have to move far), whose distances from the body no force changes. It has no solution and is left out.
bool overruled(const Contact& contact, const Tendon& c, const std::vector<Link>& links);
// The same of a contact of two tendons: all its particles that count are anchored, and keep their distances.
bool overruled(const Contact& contact, const Tendon& a, const Tendon& b, const std::vector<Link>& links);
// Reads the force of the tendon on each rigid anchor [N] from residuals that still include it.
void read_anchor_forces(Tendon& c);

}  // namespace bt
