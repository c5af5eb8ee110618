// A particle that is fixed to the world or to a link, or joined to a link by a line.
//
// A soft anchor pulls with R = K (x - aim) + c (v - w), w the velocity of its target: a hand that is led
// evenly is not braked (virtual coupling, Colgate, Stanley and Brown 1995). A grip with a force limit F slips
// beyond it: its force is min(1, F/|R|) R, the derivative of a convex function (quadratic up to F, linear
// beyond), whose Hessian is K + c/b, or F/|R| (K + c/b) (1 - n n^T) with n = R/|R| where it slips. As with
// friction, each linearisation takes the state that the last linear solution predicts. Taken from the present
// position, it could alternate between both sides of the target.
#pragma once
#include "tendon/line.h"

namespace bt {

// Where an anchor is to have its particle: a grip is led along its targets, an attachment goes with its link.
struct AnchorTarget {
  Vec3 goal;      // of a grip, at the end of the step [m]
  Vec3 aim;       // at the end of the current substep [m]
  Vec3 last_aim;  // at the end of the last substep [m]
  Vec3 velocity;  // w, the mean over the current substep [m/s]

  // Leads a grip by this share of the way from a point to its goal, in a substep of dt [s]; 0: it is at rest.
  void lead(Vec3 from, double share, double dt) {
    aim = share == 1 ? goal : (1 - share) * from + share * goal;
    velocity = dt > 0 ? (1 / dt) * (aim - last_aim) : Vec3{};
  }
};

// Force of the tendon on the link or the grip [N].
struct AnchorForce {
  Vec3 total;      // in the last solution
  Vec3 mean;       // its average over the substep
  Vec3 last_mean;  // mean of the previous substep
  Vec3 sum;        // over the finished substeps, weighted by their share of the step
  Vec3 of_step;    // average over the last step
  Vec3 read;       // what a user reads of it: with the impulse that the step before lacked when it was read
  Vec3 late;       // impulse that the last step lacked when it was read [N s] (world/resolve.cpp)
};

// Fixes a particle to a point of the world (a grip) or of a link (an attachment), rigidly or by a spring, or
// joins it to a point of a link (a line).
struct Anchor {
  int id = 0;
  int particle = 0;
  int link = -1;  // slot of the link of an attachment or a line; -1: a grip
  Vec3 local;     // its point in the link's frame [m]
  bool is_line = false;
  bool rigid = true;
  bool moves = false;     // its point moves with the unknowns of its body
  bool clamped = false;   // the direction of the end is fixed too (with bending stiffness)
  Vec3 direction;         // unit vector of the clamped end, in the order of the particles
  Sym3 stiffness;         // of the spring [N/m]; unused if rigid
  double viscosity = 0;   // of the spring's damper [N s/m]
  double most_force = 0;  // limit of a grip's force [N]; 0: none
  bool exact = false;     // a grip that is rigid up to its limit; its spring is stiff
  bool slips = false;     // its force is at the limit, or is predicted to be
  Vec3 raw;               // R in the last evaluation [N]
  AnchorTarget target;
  AnchorForce force;
  Line line;  // if it is one

  // Whether it is an attachment or a rigid grip.
  bool is_fixed() const { return (rigid || link >= 0) && !is_line; }
  // In a solution with the unknowns of its body: whether the body carries the particle, or a line pulls at
  // it.
  bool carries() const { return moves && !is_line; }
  bool pulls() const { return moves && is_line; }
  // Derivative of R by the particle's displacement, with the step weight b [N/m].
  Sym3 slope(double b) const { return stiffness + identity(viscosity / b); }
  bool exceeds_limit(Vec3 r) const { return most_force > 0 && norm(r) > most_force; }
  // The force for R.
  Vec3 limited(Vec3 r) const { return exceeds_limit(r) ? (most_force / norm(r)) * r : r; }
  // Evaluates the force, with the particle at x and its velocity v.
  void evaluate(Vec3 x, Vec3 v) {
    if (!is_line) raw = stiffness * (x - target.aim) + viscosity * (v - target.velocity);
    force.total = is_line ? line.stretch(x) : limited(raw);
  }
  // The force of the linearisation at the last evaluation, and its block for the slope k [N/m], which that of
  // a line does not depend on.
  Vec3 linearised() const {
    if (is_line) return line.linearised();
    const double size = norm(raw);
    return slips && size > 0 ? (most_force / size) * raw : raw;
  }
  Sym3 block(const Sym3& k) const {
    if (is_line) return line.block();
    const double size = norm(raw);
    if (!slips || !(size > 0)) return k;
    return (std::min(1.0, most_force / size) * k.xx) * across((1 / size) * raw);
  }
  // Decides from the last evaluation, or from the R that a linear solution predicts, whether the next
  // linearisation slips.
  void slip_if_beyond() { (is_line ? line.slips : slips) = is_line ? line.is_beyond() : exceeds_limit(raw); }
  void predict(Vec3 r) { slips = exceeds_limit(r) && !(slips && dot(r, raw) < 0); }
};

// Largest distance of an exact grip from its target before it slips, and that from which a device that pulls
// holds the particle at its point, in radii [-]. Larger: the particle is farther from there. Smaller:
// rounding of positions is felt as force.
constexpr double kGive = 1e-3;

}  // namespace bt
