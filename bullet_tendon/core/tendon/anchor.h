// A particle that is fixed to the world or to a link.
#pragma once
#include "math/sym3.h"

namespace bt {

// Fixes a particle to a point of the world (a grip) or of a link (an attachment), rigidly or by a spring.
struct Anchor {
  int id = 0;
  int particle = 0;
  int link = -1;  // slot of the link of an attachment; -1: a grip
  Vec3 local;     // its point in the link's frame [m]
  bool rigid = true;
  bool moves = false;    // its point moves with the unknowns of its body
  bool clamped = false;  // the direction of the end is fixed too (with bending stiffness)
  Vec3 direction;        // unit vector of the clamped end, in the order of the particles
  Sym3 stiffness;        // of the spring [N/m]; unused if rigid
  Vec3 goal;             // of a grip: target at the end of the step [m]
  Vec3 aim;              // target at the end of the current substep [m]
  Vec3 target_before;    // target at the end of the last step [m]
  double viscosity = 0;  // of the spring's damper [N s/m]
  // Forces of the tendon on the link or the grip [N].
  Vec3 force;       // in the last solution
  Vec3 mean_force;  // its average over the substep
  Vec3 last_mean;   // mean_force of the previous substep
  Vec3 sum_force;   // sum over the finished substeps, weighted by their share of the step
  Vec3 step_force;  // average over the last step
};

}  // namespace bt
