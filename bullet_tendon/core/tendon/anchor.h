// A particle that is fixed to the world or to a link.
//
// A soft anchor pulls with R = K (x - aim) + c (v - w), w the velocity of its target: a hand that is led
// evenly is not braked (virtual coupling, Colgate, Stanley and Brown 1995). A grip with a force limit F slips
// beyond it: its force is min(1, F/|R|) R, the derivative of a convex function (quadratic up to F, linear
// beyond), whose Hessian is K + c/b, or F/|R| (K + c/b) (1 - n n^T) with n = R/|R| where it slips. As with
// friction, each linearisation takes the state that the last linear solution predicts. Taken from the present
// position, it could alternate between both sides of the target.
#pragma once
#include <algorithm>

#include "math/sym3.h"

namespace bt {

// Fixes a particle to a point of the world (a grip) or of a link (an attachment), rigidly or by a spring.
struct Anchor {
  int id = 0;
  int particle = 0;
  int link = -1;  // slot of the link of an attachment; -1: a grip
  Vec3 local;     // its point in the link's frame [m]
  bool rigid = true;
  bool moves = false;     // its point moves with the unknowns of its body
  bool clamped = false;   // the direction of the end is fixed too (with bending stiffness)
  Vec3 direction;         // unit vector of the clamped end, in the order of the particles
  Sym3 stiffness;         // of the spring [N/m]; unused if rigid
  Vec3 goal;              // of a grip: target at the end of the step [m]
  Vec3 aim;               // target at the end of the current substep [m]
  Vec3 target_before;     // target at the end of the last substep [m]
  Vec3 drift;             // w, the mean over the current substep [m/s]
  double viscosity = 0;   // of the spring's damper [N s/m]
  double most_force = 0;  // limit of a grip's force [N]; 0: none
  bool exact = false;     // a grip that is rigid up to its limit; its spring is stiff
  bool slips = false;     // its force is at the limit, or is predicted to be
  Vec3 raw;               // R in the last evaluation [N]
  // Forces of the tendon on the link or the grip [N].
  Vec3 force;       // in the last solution
  Vec3 mean_force;  // its average over the substep
  Vec3 last_mean;   // mean_force of the previous substep
  Vec3 sum_force;   // sum over the finished substeps, weighted by their share of the step
  Vec3 step_force;  // average over the last step

  // Derivative of R by the particle's displacement, with the step weight b [N/m].
  Sym3 slope(double b) const { return stiffness + identity(viscosity / b); }
  bool exceeds_limit(Vec3 r) const { return most_force > 0 && norm(r) > most_force; }
  // The force for R.
  Vec3 limited(Vec3 r) const { return exceeds_limit(r) ? (most_force / norm(r)) * r : r; }
  // The force of the linearisation at the last evaluation, and its block for the slope k [N/m].
  Vec3 linearised() const {
    const double size = norm(raw);
    return slips && size > 0 ? (most_force / size) * raw : raw;
  }
  Sym3 block(const Sym3& k) const {
    const double size = norm(raw);
    if (!slips || !(size > 0)) return k;
    return (std::min(1.0, most_force / size) * k.xx) * across((1 / size) * raw);
  }
  // Decides from the R that a linear solution predicts whether the next linearisation slips.
  void predict(Vec3 r) {
    if (most_force > 0) slips = slips ? dot(r, raw) > 0 : exceeds_limit(r);
  }
};

// Largest distance of an exact grip from its target before it slips, in radii [-]. Larger: the particle is
// farther from the target. Smaller: rounding of positions is felt as force.
constexpr double kGive = 1e-3;

}  // namespace bt
