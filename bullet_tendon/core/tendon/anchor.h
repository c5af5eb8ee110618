// A particle that is fixed to the world or to a link.
//
// A soft anchor pulls with R = K (x - aim) + c (v - w), w the velocity of its target: a hand that is led
// evenly is not braked (virtual coupling, Colgate, Stanley and Brown 1995). A grip with a force limit F slips
// beyond it: its force is min(1, F/|R|) R, the derivative of a convex function (quadratic up to F, linear
// beyond), whose Hessian is K + c/b, or F/|R| (K + c/b) (1 - n n^T) with n = R/|R| where it slips. As with
// friction, each linearisation takes the state that the last linear solution predicts. Taken from the present
// position, it could alternate between both sides of the target.
//
// A line joins a particle to a point of a link, as hardware that fixes a graft to a bone does. Its tension is
// T = min(F, k (l - l_0 - s)), with its length l, its first length l_0, and the slip s. That is a return map,
// as that of friction: where k (l - l_0 - s) is above F at the end of a substep, s grows until it is F. A
// device that pulls is a line with l_0 = 0 that does not slip for good: it pulls by F, down to the length
// F/k. There the particle has come to its point, and has to be held there by less than F: a force F towards a
// point has no direction at that point. The particle of a line is free: a line adds no unknowns
// (solver/body_schur.cpp).
#pragma once
#include <algorithm>

#include "math/sym3.h"

namespace bt {

// Fixes a particle to a point of the world (a grip) or of a link (an attachment), rigidly or by a spring, or
// joins it to a point of a link (a line).
struct Anchor {
  int id = 0;
  int particle = 0;
  int link = -1;  // slot of the link of an attachment or a line; -1: a grip
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
  double most_force = 0;  // limit of a grip's force [N], 0: none; or F of a line
  bool exact = false;     // a grip that is rigid up to its limit; its spring is stiff
  bool slips = false;     // its force is at the limit, or is predicted to be
  Vec3 raw;               // R in the last evaluation [N]
  bool line = false;      // it is a line
  bool pulls = false;     // a line whose point moves with the unknowns of its body
  double spring = 0;      // k of a line [N/m]
  double rest = 0;        // l_0 [m]; 0: of a device that pulls
  double slip = 0;        // s [m]
  double load = 0;        // F in this substep, unbounded where no line slips [N]
  Vec3 end;               // its point on the link at the iterate [m]
  // In the last evaluation: from its point to the particle, unit vector; l [m]; k (l - l_0 - s), and T [N].
  Vec3 along;
  double length = 0, elastic = 0, tension = 0;
  // Forces of the tendon on the link or the grip [N].
  Vec3 force;       // in the last solution
  Vec3 mean_force;  // its average over the substep
  Vec3 last_mean;   // mean_force of the previous substep
  Vec3 sum_force;   // sum over the finished substeps, weighted by their share of the step
  Vec3 step_force;  // average over the last step

  // Derivative of R by the particle's displacement, with the step weight b [N/m].
  Sym3 slope(double b) const { return stiffness + identity(viscosity / b); }
  bool exceeds_limit(Vec3 r) const { return most_force > 0 && norm(r) > most_force; }
  // Whether the last evaluation is beyond the limit.
  bool is_beyond() const { return line ? elastic > load : exceeds_limit(raw); }
  // The force for R.
  Vec3 limited(Vec3 r) const { return exceeds_limit(r) ? (most_force / norm(r)) * r : r; }
  // Evaluates R and the force, with the particle at x and its velocity v.
  void evaluate(Vec3 x, Vec3 v) {
    if (line) return stretch(x);
    raw = stiffness * (x - aim) + viscosity * (v - drift);
    force = limited(raw);
  }
  // Evaluates a line whose particle is at x.
  void stretch(Vec3 x) {
    const Vec3 d = x - end;
    length = norm(d);
    along = unit_or(d, along);
    elastic = spring * (length - rest - slip);
    tension = std::min(elastic, load);
    force = tension * along;
  }
  // Lets a line slip by what is beyond its load.
  void let_slip() {
    if (rest > 0 && elastic > load) slip += (elastic - load) / spring;
  }
  // Block of a line. Of one that pushes, the turning is left out, so that the block is not indefinite.
  Sym3 line_block() const {
    const double turning = length > 0 ? std::max(0.0, slips ? load : elastic) / length : 0;
    return (slips ? 0 : spring) * outer(along) + turning * across(along);
  }
  // The force of the linearisation at the last evaluation, and its block for the slope k [N/m], which that of
  // a line does not depend on.
  Vec3 linearised() const {
    if (line) return (slips ? load : elastic) * along;
    const double size = norm(raw);
    return slips && size > 0 ? (most_force / size) * raw : raw;
  }
  Sym3 block(const Sym3& k) const {
    if (line) return line_block();
    const double size = norm(raw);
    if (!slips || !(size > 0)) return k;
    return (std::min(1.0, most_force / size) * k.xx) * across((1 / size) * raw);
  }
  // Decides whether the next linearisation of a line slips, from the displacement of the particle relative to
  // its point that a linear solution predicts.
  void predict_line(Vec3 moved) { slips = elastic + spring * dot(along, moved) > load; }
  // Decides from the R that a linear solution predicts whether the next linearisation slips.
  void predict(Vec3 r) {
    if (most_force > 0) slips = slips ? dot(r, raw) > 0 : exceeds_limit(r);
  }
};

// Largest distance of an exact grip from its target before it slips, and that from which a device that pulls
// holds the particle at its point, in radii [-]. Larger: the particle is farther from there. Smaller:
// rounding of positions is felt as force.
constexpr double kGive = 1e-3;

}  // namespace bt
