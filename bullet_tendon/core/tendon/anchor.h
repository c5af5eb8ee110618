// A particle that is held.
#pragma once
#include "math/sym3.h"

namespace bt {

// A particle tied to a point of the world (a grip) or of a link (an attachment): rigidly, or by a spring.
struct Anchor {
  int id = 0;
  int particle = 0;
  int link = -1;  // of an attachment
  Vec3 local;     // its point in the link's frame [m]
  bool rigid = true;
  bool moves = false;    // its point moves with the unknowns of its body
  bool clamped = false;  // of an end that bends: its direction is held too
  Vec3 direction;        // of the tendon there, in the order of its particles
  Sym3 stiffness;        // [N/m]; unused where rigid
  Vec3 goal;             // of a grip: where it is to be at the end of the step [m]
  Vec3 aim;              // where the point will be at the end of the part that is being solved [m]
  Vec3 target_before;    // at the end of the last step [m]
  double viscosity = 0;  // of a soft hold [N s/m]
  Vec3 force;            // of the tendon on the holder, last step [N]
  Vec3 mean_force;       // the same, averaged over the parts of a split step [N]
  Vec3 last_mean;        // mean_force of the substep before [N]
  Vec3 sum_force;        // of the parts that are done, by their share of the step [N]
  Vec3 step_force;       // on the holder, averaged over the last step [N]
};

}  // namespace bt
