// One tendon in the core: particles, springs, holds and history.
#pragma once
#include <cstdint>
#include <vector>

#include "band.h"
#include "springs.h"

namespace bt {

struct Material {
  Law law;
  double stiffness = 0;          // K of the cross-section [N]
  double damping = 0;            // C of the cross-section [N s^q]
  double shear_stiffness = 0;    // K of each shear spring [N], part of `stiffness`
  double bending_stiffness = 0;  // EI [N m^2]
  double linear_density = 0;     // [kg/m]
};

// A particle tied to a point of the world (a grip) or of a link (an attachment): rigidly, or by a
// 3x3 stiffness.
struct Hold {
  int id = 0;
  int particle = 0;
  int link = -1;  // of an attachment
  Vec3 local;     // its point in the link's frame [m]
  bool rigid = true;
  bool clamped = false;  // of an end that bends: its direction is held too
  Vec3 direction;        // of the tendon there, in the order of its particles
  Sym3 stiffness;        // [N/m]; unused where rigid
  Vec3 goal;             // where the point will be at the end of the step [m]
  Vec3 target;           // the same, at the end of the part of it that is being solved [m]
  double viscosity = 0;  // of a soft hold [N s/m]
  Vec3 force;            // of the tendon on the holder, last step [N]
  Vec3 mean_force;       // the same, averaged over the parts of a split step [N]
};

class Chain {
 public:
  // points (n); rest lengths are the distances between them.
  Chain(const std::vector<Vec3>& points, double radius, double friction, const Material& material);

  int n() const { return n_; }
  // Rest lengths of the segments [m]; masses and spring constants follow.
  void set_rest(const std::vector<double>& rest);
  // Shares of the cross-section's stiffness by segment, 1 where uniform.
  void set_stiffness_scale(const std::vector<double>& scale);
  // At rest where it is, its multipliers kept.
  void stop();
  // Lengths and multipliers at x, after positions were set from outside.
  void reset_history();
  // Raises the multipliers of loose springs to what half of all loads would pull, as a first guess at
  // the forces of an equilibrium that is far away: a tendon taken to be tight falls into shape.
  void guess_multipliers(Vec3 gravity);
  // Force carried by every cross-section: the sum over the springs that cross segment k [N].
  void tension(std::vector<double>& out) const;
  double energy() const;  // elastic and kinetic [J]

  double radius, friction;
  Material material;
  Field x, v;   // state
  Field force;  // constant external force [N]
  std::vector<double> mass;
  std::vector<double> rest;  // of the segments
  std::vector<double> scale;
  SpringSet structure, shear;
  std::vector<Hold> holds;
  std::vector<int> tunnel_of;  // tunnel slot a particle is in, or -1

  // History of the integrator.
  Field x_before, v_before;  // one step back (bdf2, starting guess)
  double dt_before = 0;      // 0: no history
  bool smooth = true;        // nothing was made, lost or changed since: two-step methods may go on
  uint64_t touching = 0;     // a hash of the contacts with bodies
  double b = 0;              // step weight of this step (stepping.h)

  // The state before a step that is being split, and whether it was (splitting.cpp).
  Field start_x, start_v;
  std::vector<double> start_carried[2], start_elastic[2];
  bool split = false;     // parts of the step are being solved
  bool gathered = false;  // next and step hold the positions and velocities at their end

  // Work space of a step.
  Field next, step, residual, anchor_x, anchor_v, goal, cg_remainder, cg_preconditioned, cg_direction,
      cg_image;
  Band matrix;
  BandFactor factor;
  Planes inverse_blocks;
  double residual_norm = 0;  // largest residual force [N]
  int worst_particle = 0;

 private:
  template <class A>
  friend void fields(A& a, Chain& chain);  // state.h
  void share_out();
  int n_;
};

}  // namespace bt
