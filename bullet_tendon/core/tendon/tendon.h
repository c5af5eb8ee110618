// One tendon in the core: particles, springs, holds and history.
#pragma once
#include <cstdint>
#include <vector>

#include "tendon/anchor.h"
#include "tendon/axial_springs.h"
#include "tendon/material.h"

namespace bt {

// Contacts are foreseen over the motion that the step is begun with, and this share of the radius [-].
// What moves otherwise than that makes the step look again. Larger: more queries and rows. Smaller:
// more looks.
constexpr double kSlack = 0.05;

// What of a tendon only the user changes. A step changes nothing of it.
struct TendonModel {
  Field force;                     // constant external force [N]
  std::vector<double> rest;        // lengths of the segments without load [m]
  std::vector<double> point_mass;  // added to the particles [kg]
  std::vector<double> mass;        // of the particles, from rest lengths and point masses [kg]
};

// What of a tendon a step changes, beside its springs.
struct TendonState {
  Field x, v;
  std::vector<Anchor> anchors;
  std::vector<uint64_t> overlaid;  // pairs, the lower segment in the upper half
  std::vector<int> tunnel_of;      // tunnel slot a particle is in, or -1
  // History of the integrator.
  Field x_before, v_before;  // one step back (bdf2, starting guess)
  double dt_before = 0;      // 0: no history
  bool smooth = true;        // nothing was made, lost, changed or struck since: two-step methods may go on
  double quiet = 0;          // for how long it has been at rest, up to the last step [s]
  int bed = -1;              // it sleeps (world/sleeping.cpp), with all others of the same number
  uint64_t touching = 0;     // a hash of the contacts with bodies
  bool touched = false;      // a contact pressed on it in the last step
};

// Where particles are predicted to be at the end of the step [m], and by how much they may miss it [m]:
// around there contacts are looked for.
struct PredictedRegion {
  Field predicted;
  std::vector<double> slack;
  double most_slack = 0;
};

// Work space of a step: nothing of it outlasts one. The unknown is the displacement from the start of the
// step; the positions at its end, x_new, are x + displacement, rounded.
struct TendonWorkspace : PredictedRegion {
  double h_eff = 0;               // step weight of this step (integrator/scheme.h)
  Multipliers start_multipliers;  // at the start of the substep
  double history = 0;             // share of the step before in the history: xh = x + history (x_before - x)
  Field displacement, x_new;
  Field v_new;                  // at the end of the step
  Field inertial_displacement;  // y - x, where the particles would be without forces of springs and contacts
  Field dx, residual, cg_remainder, cg_preconditioned, cg_direction, cg_image, column, solved;
  Band matrix;
  BandFactor factor;
  Planes inverse_blocks;
  double residual_norm = 0;  // largest residual force [N]
  int worst_particle = 0;
};

class Tendon : public TendonModel, public TendonState, public TendonWorkspace {
 public:
  // points (n); rest lengths are the distances between them.
  Tendon(const std::vector<Vec3>& points, double radius, double friction, const Material& material);

  int n() const { return n_; }
  double shortest_rest() const;  // of its segments [m]
  double rest_length() const;    // of all of it [m]
  // Rest lengths of the segments [m]; masses and spring constants follow.
  void set_rest(const std::vector<double>& rest);
  // A weight on a particle beside the tendon's own mass [kg]; 0: none.
  void set_point_mass(int particle, double kilograms);
  Motion motion() const { return {x, displacement, x_before, history, h_eff}; }
  // Change the displacement of a particle, and x_new; of all particles, by alpha dx.
  void move(int particle, Vec3 by);
  void place(int particle, Vec3 at);
  void advance(double alpha);
  // At rest where it is, its multipliers kept.
  void stop();
  void keep_multipliers(Multipliers& to) const;
  void restore_multipliers(const Multipliers& from);
  // Where contacts are to be looked for: around the end of the step as it is thought to be now.
  void predict();
  // Particles at the place of their neighbour get a direction from it.
  void spread_coincident();
  // Pairs of own segments laid through each other, which do not touch until they have parted.
  void find_overlaid();
  bool is_overlaid(int k, int m) const;
  void let_overlaid_part();
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
  SpringSet structure, shear;
  int rest_set = 0;  // how often rest lengths were

 private:
  void share_out();
  int n_;
};

// Whether any particle ends up elsewhere than foreseen.
bool leaves_predicted_region(const Tendon& c);

}  // namespace bt
