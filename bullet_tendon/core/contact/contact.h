// A contact: a temporary spring with friction between a point of a tendon and a body, a tunnel, or a point of
// a tendon (paper, section 4.1).
//
//   g = n.(x_a - x_b) - c                  gap of a plane contact [m]
//   g = (R - r) - |across(axis)(x_a - p)|  gap of a bore contact [m]; n points to the axis
//   g = |x_a - nearest on edge| - r        gap of a mouth contact [m]
//   g = |across(axis)(x_a - p)| - (R + r)  gap of a segment over a round surface of radius R [m]
//   N = max(0, N_0 - k g)                  normal force [N]; N_0 is the carried multiplier
//   z = xi + across(n)(x_a - x_b - ref)    tangential displacement from the sticking point [m]
//   F_t = -k_t z, |F_t| <= mu N            friction [N]: Coulomb's return map
//
// With N_0 = 0 this is the paper's spring. With a carried multiplier (N_0 <- N after every step), a contact
// at rest has no depth, whatever its load, and k only sets how fast that state is reached. N_0 is the smaller
// of the normal forces of the last two steps. Otherwise the force of an impact would be repeated, and the
// tendon would rebound. Where a gap or a depth remains beside a normal force at the end of a step, N_0 <- N,
// k grows, and the step is solved further (augmented Lagrangian, Hestenes 1969). A force across a gap is what
// a load leaves behind that rolls on: it would lift the tendon behind it, and drive it.
//
// A tendon between bodies that do not yield, closer together than it is thick, is squeezed: no force closes
// its contacts, and N would grow in every solution. They press as its cross-section does, which is elastic:
//
//   N = pi/4 E l d,   E = stiffness / (pi r^2)   [N]; d depth, l length of tendon at the contact [m]
//
// (Popov 2010, Contact Mechanics and Friction, section 5.3). Where a motor or another hold of unknown limit
// may be what does not yield, k is larger: the limit is known only after it has yielded to such a force
// (bodies/joint_motors.h). One that has withstood what would throw the body at the rate that pybullet cuts
// off does not yield.
#pragma once
#include <cmath>
#include <cstdint>
#include <tuple>

#include "contact/segment_point.h"
#include "geometry/segment_distance.h"
#include "geometry/tunnel_bore.h"
#include "tendon/axial_springs.h"

namespace bt {

// Least distance of two centrelines, on the straight way since the start of the step, at which they cannot
// have crossed, in sums of radii [-].
constexpr double kNearlyMet = 0.2;

enum class ContactKind : int { bone = 0, bore = 1, mouth = 2, tendon = 3 };

// Identifies a contact. The key is the same in every step of the contact's duration.
struct ContactKey {
  ContactKind kind = ContactKind::bone;
  int tendon = 0, feature = 0;  // bone: particle i, or n + k for segment k; else particle or segment
  int other = 0;                // shape, tunnel, 2 tunnel + mouth, or the other tendon
  int other_feature = 0;        // segment of the other tendon
  int end = 0;                  // end of the stretch along which nearly parallel segments touch; half of
                                // the edge of a mouth; bone: side of a valley, + 2 at the first and + 4 at
                                // the last end of the part of a segment that lies along the surface
};

inline bool operator<(const ContactKey& a, const ContactKey& b) {
  return std::tie(a.kind, a.tendon, a.feature, a.other, a.other_feature, a.end) <
         std::tie(b.kind, b.tendon, b.feature, b.other, b.other_feature, b.end);
}

inline bool operator==(const ContactKey& a, const ContactKey& b) { return !(a < b) && !(b < a); }

// The contact surface, and the gap to it.
struct ContactGeometry {
  Vec3 normal;                 // n; of bores, mouths and pairs that follow, as last evaluated
  double offset = 0;           // c; distance kept from the edge of a mouth [m]
  double gap = 0;              // g, as last evaluated [m]
  double depth_allowance = 0;  // negative gap that may remain at the end of a substep [m]
  double depth_to_leave = 0;   // the same, where the cross-section does not bear it [m]
  double margin = 0;           // distance of the surfaces at zero gap (threshold) [m]
  double radius = 0;           // of the tendon, or the sum of both tendons' radii [m]
  Rim rim;                     // mouth: its edge; bore: a circle of its wall, less the tendon's radius; round
                               // surface: a circle of the cylinder, plus the tendon's radius; without axis:
                               // a sphere
  Rim foreseen_rim;            // mouth and bore: its rim where that is foreseen to be
  Vec3 rim_shift;              // displacement of the contact point with the body, less that of the rim [m]
  RimPoint edge;               // mouth: the point of its edge, as last evaluated
  bool threads_mouth = false;  // mouth contact of a segment that passes through the mouth
  bool beyond_edge = false;    // it passes there beyond the edge, within the bone
  Vec3 side;                   // pair: n at the start of the step
  double handedness = 0;       // pair: sign of n.(l_a x l_b) there; 0: a contact point is at an end
  bool parallel = false;       // pair of nearly parallel segments, whose contact points are fixed
  bool follows = false;        // pair whose contact points are the present nearest points
  Vec3 bend[2];                // mouth and bore: of its segment (geometry/bent_segment.h), of the substep's
                               // start, turned as the rim [m]
  Vec3 foreseen_bend[2];       // mouth and bore: the same where the rim is as foreseen [m]
  Vec3 bulge;                  // mouth and bore: of the segment at the contact point, as last evaluated [m]
  Stretch slides;              // round surface: where the contact point of the segment may be [-]
  Vec3 point_shift;            // from the first contact point to the present one, at the start [m]
  // Contacts whose points slide along their segments: each term adds share l l^T to the block, with l over
  // the ends of a, then of b. l = sliding_term [-], share = sliding_share [N/m].
  int sliding_terms = 0;
  Vec3 sliding_term[2][4];
  double sliding_share[2] = {};
};

// Of a curved surface at the contact point: the tangential unit vector around its axis or along its edge, and
// the curvatures in that direction and across it [1/m]. Negative: convex.
struct SurfaceCurvature {
  Vec3 direction;
  double along = 0, across = 0;
  bool any() const { return along != 0 || across != 0; }
};

// Whether a contact bears by the cross-section, because nothing yields to it: before this substep, or as
// found in it (Contact::stiffen).
enum class Squeezed { no, before, now };

struct NormalForce {
  double value = 0;             // N, as last evaluated [N]
  double stiffness = 0;         // k [N/m]
  double first_stiffness = 0;   // k at first [N/m]; 0: k is the user's and does not change
  double section = 0;           // k of the tendon's cross-section that is squeezed [N/m]
  double lambda = 0;            // N_0 [N]
  double lambda_previous = 0;   // N of the previous step [N]
  double lambda_predicted = 0;  // predicted N; scales the curvature terms of the block [N]
  bool pressed = false;         // has a normal force in the linearisation
  bool direct = false;          // a constraint of the particle (Baraff and Witkin 1998), not a spring
  bool held = false;            // active direct contact
  double first_gap = 0;         // gap at which it was first stiffened in the substep; 0: it was not [m]
  Squeezed squeezed = Squeezed::no;
};

struct Friction {
  double coefficient = 0;         // mu [-]
  double limit = 0;               // mu N [N]
  double stiffness = 0;           // k_t, while it sticks [N/m]
  Vec3 anchor, relative_start;    // xi, ref [m]
  Vec3 along_start, other_start;  // segments of a and b at the start, carried as ref is [m]
  double anchored_at = 0;         // parameter in a's segment of the point of ref [-]
  double anchored_at_other = 0;   // the same in b's segment [-]
  bool sliding = false;           // slides in the linearisation; else it sticks
  Vec3 raw, displacement, force;  // as last evaluated: z [m], z returned to the cone [m], F_t [N]
};

// Forces at the point a.
struct ContactForce {
  Vec3 total;      // as last evaluated [N]
  Vec3 linear;     // of the linearisation; equals total if that is of the present state [N]
  Vec3 mean;       // total, averaged over the substep by the integrator [N]
  Vec3 last_mean;  // mean of the previous step [N]
  Vec3 given;      // to what it acts on, in this step and in the previous one [N] (World::given)
  Vec3 last_given;
  Sym3 block;    // minus the derivative of the linear force [N/m]
  Sym3 turning;  // the part of it by which the normal of a rim turns with the place relative to the rim [N/m]
};

struct Contact {
  ContactKey key;
  SegmentPoint a, b;  // b.tendon = -1: contact with a link
  int link = -1;
  bool moves = false;     // the link's body is an unknown of the solve
  Vec3 arm;               // contact point, from that body's centre of mass [m]
  Vec3 rim_arm;           // centre of the rim, from that centre of mass [m]
  bool at_start = false;  // that point is of the start of the substep, else of its end
  bool joins = false;     // couples two tendons in the pattern of their matrix
  ContactGeometry geometry;
  SurfaceCurvature curvature;  // as last evaluated
  NormalForce normal_force;
  Friction friction;
  ContactForce force;

  // Whether there is a force. A released contact keeps its friction until its friction limit is updated.
  bool acts() const {
    return normal_force.pressed || normal_force.held ||
           (!normal_force.direct && friction.coefficient > 0 && friction.limit > 0);
  }
  // Forces at relative = x_a - x_b [m]. at_position: the activation, the sliding and the normal force of the
  // curvature terms are those of this position, else the predicted ones.
  void evaluate(Vec3 relative, bool at_position);
  // Linear force and block where it was evaluated. definite: the terms that can make the block indefinite are
  // left out, such as the convex edge of a mouth.
  void linearise(bool definite);
  // Whether the surface is round, and the contact point that of a segment which is nearest to it.
  bool is_round() const { return key.kind == ContactKind::bone && geometry.rim.radius > 0; }
  // A force without friction passes through the centre of a round surface, wherever it acts.
  bool acts_at_centre() const { return is_round() && friction.coefficient == 0; }
  // Whether the gap is that of a curved surface, else of a plane.
  bool is_curved() const { return key.kind == ContactKind::bore || follows(); }
  // Whether the surface turns with its body in a solution. A round one need not, because its normal leads
  // through the centre that moves with the body. Planes stay as they were detected.
  bool turns() const { return key.kind == ContactKind::mouth || key.kind == ContactKind::bore; }
  // Turns such a surface from where it is foreseen to be, and the bend of the segment with it. With a bend
  // that did not turn, what turns the tendon and the surface alike would change the gap.
  void turn(const Rot3& by);
  // Whether the contact point slides along its segment.
  bool follows() const { return key.kind == ContactKind::mouth || is_round(); }
  // From the body's centre of mass to the surface. The arm of a force without friction leads to the axis.
  Vec3 touched_arm() const { return is_round() ? rim_arm + geometry.rim.radius * geometry.normal : arm; }
  // Puts the contact point to the parameter u of its segment, or as near as it may be.
  void slide_to(double u);
  // Finds the point of the segment start-end nearest to the edge or the round surface, from the last one.
  void follow(Vec3 start, Vec3 end);
  // Sets the sliding term that the motion of this point along the segment adds to the block
  // (contact/following.cpp). Call it after linearise.
  void add_sliding_term(Vec3 start, Vec3 end, bool definite);
  // Distance of the surfaces; negative: depth [m].
  double distance() const { return geometry.gap + geometry.depth_allowance + geometry.margin; }
  // Whether no gap or depth remains that is too large.
  bool is_closed() const;
  // Makes k so large that a load [N] presses no deeper than may remain, even without a multiplier, and k_t
  // larger by a share of what the load takes from the transverse stiffness of a tendon that lies on another,
  // load / r. Multipliers follow a step late: on slack tendons, which are light, a heavy body would rock for
  // ever on contacts as soft as their inertia.
  void bear(double load, double sticking_ratio);
  // If there is a normal force at a gap or depth that is too large, sets N_0 <- N and increases k. Returns
  // whether it did. One that this does not close bears by the cross-section. by_what_yields: what presses on
  // it may give way. finds_out: it does so at a force of its own, which the contact has to show.
  bool stiffen(bool by_what_yields, bool finds_out);
  // Whether it may: its stiffness can change, and its gap or its force is too large.
  bool may_stiffen() const;
  // If a smaller k leaves no gap or depth that is too large, decreases k. Returns whether it did.
  bool soften();
  // Sets N_0 to force [N] and increases k.
  void take_over(double force);
  // mu N less the friction limit [N].
  double limit_error() const { return friction.coefficient * normal_force.value - friction.limit; }
  // Coulomb's cone: sets the friction limit to mu times a normal force [N]. Nothing else computes the limit.
  void limit_friction(double normal) { friction.limit = friction.coefficient * normal; }
  // Normal force of the linearisation after the relative displacement `moved` [m]; negative: released [N].
  double force_after(Vec3 moved) const {
    return normal_force.lambda - normal_force.stiffness * (geometry.gap + dot(geometry.normal, moved));
  }
  // Predicts the normal force, the friction limit and the sliding for the next iteration, from the relative
  // displacement of this iteration [m]. They are multipliers, like the forces of springs. Contacts are stiff,
  // therefore values of the present positions would change by large amounts between iterations. A sticking
  // contact starts to slide when its friction would exceed the limit. A sliding contact sticks when it would
  // reverse. A contact without a limit has slid freely. It stays sliding while its friction would exceed mu
  // N, because sticking would pull it back over the whole distance. keeps_limit: the friction limit stays.
  void predict(Vec3 moved, bool keeps_limit);
  // The same for a pair of segments with the ends x [m] (contact/segment_pair.cpp). begin_pair keeps what the
  // segments' vectors at the start of the step [m] say about which side is which.
  void begin_pair(Vec3 along, Vec3 other);
  void follow_pair(const Vec3 (&x)[4]);
  void add_pair_sliding_terms(const Vec3 (&x)[4], bool definite);
  // Gap, normal and curvature at x of the edge of a mouth (contact/following.cpp), and of the wall of a bore
  // or a round surface.
  void mouth_gap(Vec3 x);
  void round_gap(Vec3 x);
  // Updates z at the end of a step with forces of its start (solver/published_methods.cpp).
  void settle(Vec3 relative);

  // Lets it press as the tendon's cross-section does, `before` this substep or as found `now`.
  void bear_by_section(Squeezed since);

 private:
  bool is_unmoved() const;
  bool is_squeezed();
  // Whether it presses lastingly with more than the tendon's cross-section can bear.
  bool is_crushed() const;
};

// Resistance of a point of a tendon to displacement.
struct HeldBack {
  double stiffness = 0;  // tangent stiffness there, inertia included [N/m]
  double inertia = 0;    // mass of the particles there over h_eff^2 [N/m]
  double arc = 0;        // of all particles along a round surface together, away from it [N/m]
  double section = 0;    // of the cross-section that is squeezed there [N/m]
};

// Hash of a key. The sum of the hashes identifies a set of keys. The multipliers are those of 64-bit FNV-1a
// and the golden ratio.
inline uint64_t hash_of(const ContactKey& key) {
  uint64_t hash = 14695981039346656037ull;
  for (const int part :
       {static_cast<int>(key.kind), key.tendon, key.feature, key.other, key.other_feature, key.end})
    hash = (hash ^ static_cast<uint32_t>(part)) * 1099511628211ull;
  return (hash ^ hash >> 32) * 0x9e3779b97f4a7c15ull;
}

}  // namespace bt
