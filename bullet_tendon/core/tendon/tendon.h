// One tendon in the core: particles, springs, anchors and history.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tendon/anchor.h"
#include "tendon/axial_springs.h"
#include "tendon/material.h"

namespace bt {

// Contacts are detected around the predicted positions at the end of the substep. A particle may miss its
// predicted position by this share of the radius [-]. Otherwise contacts are detected again. Larger: more
// queries and contacts. Smaller: more detections.
constexpr double kSlack = 0.05;

// Two segments of one tendon can touch only if the arc length between them exceeds this [m]. A
// tendon in the tightest possible bend (radius of the centreline = radius of the tendon) touches itself
// after half a turn. Smaller: neighbours push each other apart in every bend.
inline double self_contact_arc(double radius) { return M_PI * radius; }

// The part of a tendon that only the user changes. A step never changes it.
struct TendonModel {
  Field force;                     // constant external force [N]
  std::vector<double> rest;        // rest lengths of the segments [m]
  std::vector<double> point_mass;  // additional masses of the particles [kg]
  std::vector<double> mass;        // masses of the particles, point masses included [kg]
};

// A segment that runs through a bore, in at one mouth and out at the other.
struct Threaded {
  int segment = 0, tunnel = 0;
};

// The part of a tendon that a step changes, except the springs.
struct TendonState {
  Field x, v;  // positions [m] and velocities [m/s] of the particles
  std::vector<Anchor> anchors;
  std::vector<uint64_t> overlaid;  // overlapping segment pairs (find_overlaid), lower index in the upper half
  std::vector<int> tunnel_of;      // tunnel slot that each particle is in, or -1
  std::vector<Threaded> threaded;  // segments with both ends outside of a bore that they run through
  // History of the integrator.
  Field x_before, v_before;  // one step back [m], [m/s] (bdf2, starting guess)
  double dt_before = 0;      // length of that step [s]; 0: no history
  bool smooth = true;        // no anchor or contact changed and no impact since: bdf2 needs no restart
  double quiet = 0;          // duration of rest up to the last step [s]
  // >= 0: asleep, with all tendons of the same number (world/sleeping.cpp).
  int sleeping_island = -1;
  std::vector<int> torn;  // segments that have ruptured
  uint64_t touching = 0;  // hash of the contacts that have a force
  bool touched = false;   // a contact exerted a force on it in the last step
  // The last step was solved together with bodies that have a history: mean_velocities are then
  // those that correspond to the bodies' (u of bodies/body_history.h).
  bool with_body = false;
  Field mean_velocities;    // [m/s]
  double steady_share = 1;  // of the last step's forces (World::begin_histories)
};

// The region in which contacts are detected: predicted positions at the end of the substep [m], and the
// distance by which each particle may miss its predicted position [m].
struct PredictedRegion {
  Field predicted;
  std::vector<double> slack;
  double most_slack = 0;  // largest slack [m]
};

// The linear system of a step of Newton's method, and its solution (solver/linear_solve.cpp).
struct NewtonSystem {
  Field residual;  // minus the right-hand side [N]
  Band matrix;
  BandFactor factor;
  Field dx, correction;  // the step, and its second-order correction (solver/arc.cpp) [m]
  Field column, solved;  // another right-hand side, and its solution
  // Of conjugate gradients.
  Planes inverse_blocks;
  Field cg_remainder, cg_preconditioned, cg_direction, cg_image;
};

// Workspace of a substep. Nothing in it outlasts a step. The unknown is the displacement since the start of
// the substep. The positions at its end, x_new, are x + displacement, rounded.
struct TendonWorkspace : PredictedRegion, NewtonSystem {
  double h_eff = 0;                                // step weight b [s] (integrator/scheme.h)
  SpringMultipliers start_structure, start_shear;  // at the start of the substep
  Relaxation relaxation;
  std::vector<double> loads;  // of the cross-sections, to find a rupture [N]
  bool coupled = false;       // in this step, to a body that has a history
  bool barred = false;        // to one that cannot have one
  bool limited = false;       // it could pass through something in this substep
  double history = 0;         // weight of the previous step in the history: xh = x + history (x_before - x)
  Field displacement, x_new;
  Field v_new;                  // at the end of the substep [m/s]
  Field inertial_displacement;  // y - x, the displacement without forces of springs and contacts [m]
  std::vector<char> pressed;    // what presses on particles that may give way: Presser (solver/newton.cpp)
  double residual_norm = 0;     // largest residual force [N]
  int worst_particle = 0;
};

// The farthest turn of a taut tendon at a particle on a body or another tendon, where it is too far
// (world/report.cpp).
struct CoarseTurn {
  int particle = -1;
  int link = -1, other = -1;  // slot of the link, or of the other tendon
  double angle = 0;           // [rad]
  double sliding = 0;         // largest one there while the tendon slides [rad]
  double winding = 0;         // of a segment around the other tendon that it winds around [rad]
  double bent = 0;            // what its segment bends of that before the contact, at a mouth [rad]
  double friction = 0;        // coefficient of the contact [-]
  int steps = 0;              // for which it has lasted
  bool reported = false;      // once for each tendon
};

class Tendon : public TendonModel, public TendonState, public TendonWorkspace {
 public:
  // The rest lengths are the distances between the n points [m].
  Tendon(const std::vector<Vec3>& points, double radius, double friction, const Material& material);

  int n() const { return n_; }
  double shortest_rest() const;  // smallest rest length of a segment [m]
  double rest_length() const;    // sum of all rest lengths [m]
  // Sets the rest lengths of the segments [m], and updates masses and spring constants.
  void set_rest(const std::vector<double>& rest);
  // Sets the additional mass of a particle [kg].
  void set_point_mass(int particle, double kilograms);
  // The velocities that the user sees [m/s].
  const Field& user_velocities() const { return with_body ? mean_velocities : v; }
  // Greatest predicted motion of a particle in the substep [m].
  double most_motion() const;
  Motion motion() const { return {x, displacement, x_before, history, h_eff}; }
  // These three change displacement and x_new: of a particle by `by`, of a particle to the position `at`, of
  // all particles by alpha dx + second correction.
  void move(int particle, Vec3 by);
  void place(int particle, Vec3 at);
  // Places the particles of rigid anchors at their targets.
  void place_anchors();
  void advance(double alpha, double second = 0);
  // Sets all velocities to zero and clears the history. Keeps positions and multipliers.
  void stop();
  // Whether a segment runs through a bore with both ends outside of it; and whether any does.
  bool threads(int segment, int tunnel) const;
  bool threads(int tunnel) const;
  // Whether a segment is in a bore, or one of its ends is; and whether any is.
  bool is_in_bore(int segment, int tunnel) const;
  bool is_in_bore(int tunnel) const;
  void leave_bore(int tunnel);
  void leave_bores();
  bool is_torn(int segment) const { return std::find(torn.begin(), torn.end(), segment) != torn.end(); }
  // Time in the tissue of a substep of h [s], 0 where no time passes (tendon/tissue.h).
  void begin_tissue(double h);
  void end_tissue(double h);
  // Keeps the multipliers at the start of a substep, and returns to them.
  void keep_multipliers();
  void restore_multipliers();
  // Centres the predicted region, in which contacts are detected, on x_new.
  void predict();
  // Moves each particle that coincides with its neighbour by a small distance, so that the segment has a
  // direction.
  void spread_coincident();
  // Finds the pairs of segments of this tendon that overlap at the start (tendon/initial_overlap.cpp). They
  // have no contacts until they have separated.
  void find_overlaid();
  bool is_overlaid(int k, int m) const;
  void let_overlaid_part();
  // Computes lengths and multipliers at x, after positions were set from outside.
  void reset_history();
  // Raises the multipliers of all springs to at least the tension under half of the total load. This is a
  // starting guess for a distant equilibrium: a tendon that is assumed to be tight converges to it.
  void guess_multipliers(Vec3 gravity);
  // The tension of each segment k: the sum of the forces of the springs that cross it [N].
  void tension(std::vector<double>& out) const;
  double energy() const;  // elastic and kinetic [J]
  // Computes the spring constants from rest lengths, material and torn segments.
  void share_out();

  double radius, friction;  // [m], Coulomb coefficient [-]
  Material material;
  SpringSet structure, shear;
  int rest_set = 0;  // number of calls of set_rest
  CoarseTurn coarse;

 private:
  void rupture();
  int n_;
};

// The anchor of a particle, if it is an attachment or a rigid grip; else null.
const Anchor* fixed_anchor(const Tendon& c, int particle);
// Whether x_new of any particle is outside its predicted region.
bool leaves_predicted_region(const Tendon& c);

// Bending (tendon/bending.cpp): the energy at x [J], the gradient at x added to the residual, the Hessian
// added to the matrix, and the force on particle i at the positions x + u [N].
double bending_energy(const Tendon& c, const Field& x);
void add_bending_forces(Tendon& c, const Field& x);
void add_bending_blocks(Tendon& c);
Vec3 bending_force(const Tendon& c, const Field& x, const Field& u, int i);

// Call it after tendon.dx was added to tendon.x_new. Removes the elongation of segments that is caused by
// their rotation alone (tendon/segment_rotation.cpp).
void keep_lengths(Tendon& c);
// Largest sine of the angle by which a segment rotates from tendon.x to the iterate tendon.x_new. A segment
// that is exactly reversed counts as not rotated.
double greatest_turn(const Tendon& c);

}  // namespace bt
