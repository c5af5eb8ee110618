// A contact: one temporary constraint spring between a point of a tendon and a body, a tunnel or a point of a
// tendon (paper, section 4.1), with its friction.
//
//   g = n.(x_a - x_b) - c                  gap of a plane contact [m]
//   g = (R - r) - |across(axis)(x_a - p)|  gap of a bore contact: n points to the axis
//   g = |x_a - nearest on circle| - r      gap of a mouth contact
//   N = max(0, N_0 - k g)                  normal force [N], N_0 the multiplier carried over steps
//   z = xi + across(n)(x_a - x_b - ref)    displacement from where it stuck [m]
//   F_t = -k_t z, at most mu N along z       Coulomb's return map [N]
//
// With N_0 = 0 it is the paper's spring. With a carried multiplier (N_0 <- N after every step) a contact at
// rest has no depth, whatever its load, and k sets only how fast that is reached. N_0 is the smaller one of
// the forces of the last two steps: the force of an impact, if it were repeated, would throw off what it has
// stopped. Where depth remains at the end of a step, N_0 <- N, k grows, and the step is solved further
// (augmented Lagrangian, Hestenes 1969).
#pragma once
#include <cmath>
#include <cstdint>
#include <tuple>

#include "contact/segment_point.h"
#include "tendon/axial_springs.h"

namespace bt {

// Distance of centrelines, in sums of radii, below which the direction between them is not used as a normal
// [-].
constexpr double kNearlyMet = 0.2;

enum class ContactKind : int { bone = 0, bore = 1, mouth = 2, tendon = 3 };

// Identifies a contact in every step for as long as it lasts.
struct ContactKey {
  ContactKind kind = ContactKind::bone;
  int tendon = 0, feature = 0;  // of a bone: particle i, or n + k for segment k; else particle or segment
  int other = 0;                // shape, tunnel, of a mouth 2 tunnel + mouth, or the other tendon
  int other_feature = 0;        // of the other tendon: its segment
  int end = 0;                  // of the stretch along which nearly parallel segments touch
};

inline bool operator<(const ContactKey& a, const ContactKey& b) {
  return std::tie(a.kind, a.tendon, a.feature, a.other, a.other_feature, a.end) <
         std::tie(b.kind, b.tendon, b.feature, b.other, b.other_feature, b.end);
}

inline bool operator==(const ContactKey& a, const ContactKey& b) { return !(a < b) && !(b < a); }

// The surface that is touched, and the gap to it.
struct ContactGeometry {
  Vec3 normal;                 // n, of a plane contact; of a bore contact as last evaluated
  double offset = 0;           // c; of a mouth contact, the distance kept from the circle
  double gap = 0;              // g, as last evaluated [m]
  double depth_allowance = 0;  // gap, negative, that may be left at the end of a substep [m]
  double margin = 0;           // by how much the gap stands off the surfaces (threshold) [m]
  double radius = 0;           // of the tendon, or the sum of both [m]
  Vec3 axis_point, axis;       // of a bore; of a mouth, the circle's centre and axis
  double feature_radius = 0;   // of a bore, R - r; of a mouth, the circle's radius [m]
  bool threads_mouth = false;  // a mouth contact of a segment that passes through the mouth
  Vec3 side;                   // of a pair: n as the step began
  bool parallel = false;       // a pair of nearly parallel segments, whose points do not move
  bool follows = false;        // a pair whose points are the nearest ones now
  Vec3 point_shift;            // from the point that touched at the start to the one that touches now
  // Of contacts whose points move along their segments: the block has share l l^T on the ends of a, and of b.
  int sliding_terms = 0;
  Vec3 sliding_term[2][4];
  double sliding_share[2] = {};
};

struct NormalForce {
  double value = 0;             // N, as last evaluated [N]
  double stiffness = 0;         // k [N/m]
  double softest = 0;           // k to begin with; 0: it is the user's, and does not grow where depth remains
  double lambda = 0;            // N_0 [N]
  double lambda_previous = 0;   // N of the step before [N]
  double lambda_predicted = 0;  // predicted N, in the curvature [N]
  bool pressed = false;         // touches, in the linearisation
  bool direct = false;          // constrained on the particle (Baraff and Witkin) instead of by a spring
  bool held = false;            // a direct contact that holds now
  int changes = 0;              // how often a direct contact let go in this step
};

struct Friction {
  double coefficient = 0;         // mu
  double limit = 0;               // mu N [N]
  double stiffness = 0;           // k_t, of sticking [N/m]
  Vec3 anchor, relative_start;    // xi, ref
  double anchored_at = 0;         // the point of the segment that ref is of, where that moves
  double anchored_at_other = 0;   // the same of b
  bool sliding = false;           // else it sticks, in the linearisation
  Vec3 raw, displacement, force;  // as last evaluated: z, z returned to the cone, F_t
};

// Forces on the point a.
struct ContactForce {
  Vec3 total;      // as last evaluated [N]
  Vec3 linear;     // of the linearisation; the total where that is at the present state [N]
  Vec3 mean;       // total, averaged over the substep by the integrator [N]
  Vec3 last_mean;  // mean of the step before [N]
  Sym3 block;      // derivative of the linear force, of opposite sign [N/m]
};

struct Contact {
  ContactKey key;
  SegmentPoint a, b;  // b.tendon = -1: against a link
  int link = -1;
  bool moves = false;   // the link goes with its body's unknowns,
  Vec3 arm;             // by its point at this from the centre of mass [m]
  bool joins = false;   // two tendons, in the pattern of their matrix
  bool passes = false;  // it is predicted not to touch
  ContactGeometry geometry;
  NormalForce normal_force;
  Friction friction;
  ContactForce force;

  // Whether there is a force: a contact that lets go keeps its friction until the limit is set anew.
  bool acts() const {
    return normal_force.pressed || normal_force.held ||
           (!normal_force.direct && friction.coefficient > 0 && friction.limit > 0);
  }
  // Forces and block at x_a - x_b. Whether it touches and slides, and the normal force in the
  // block's curvature, are as foreseen, or (at_position) as the position has them. definite: the block
  // without what would make it indefinite, like the edge of a mouth that pushes what slides over it.
  void evaluate(Vec3 relative, bool at_position, bool definite = true);
  // Of a mouth contact: the point of the segment that is nearest to the edge, from the last one.
  void follow(Vec3 start, Vec3 end);
  // What that point's motion along the segment adds to the block (see contact/mouth_edge.cpp), after
  // evaluate.
  void add_sliding_term(Vec3 start, Vec3 end, bool definite);
  // k too small: the multiplier takes over the force that there is, and k grows. false: depth is small.
  bool stiffen();
  void take_over(double force);
  // What Coulomb's law asks of the friction limit, mu N, less the limit [N].
  double limit_error() const { return friction.coefficient * normal_force.value - friction.limit; }
  void limit_friction() {
    friction.limit = normal_force.direct ? friction.limit : friction.coefficient * normal_force.value;
  }
  // The normal force that the linearisation foresees there; below 0 where it lets go.
  double force_after(Vec3 moved) const {
    return normal_force.lambda - normal_force.stiffness * (geometry.gap + dot(geometry.normal, moved));
  }
  // The normal force, the friction limit, and whether the contact slides, in the next iteration, from the
  // relative displacement that this one found. They are multipliers like those of springs: taken from present
  // positions they are wild, because contacts are stiff. A contact that sticks slides when its force would
  // exceed the limit. One that slides sticks when it would go back. One that had no limit slid freely: if it
  // were taken to stick, it would be pulled back all the way that it has slid.
  void predict(Vec3 moved);
  // The same of a pair of segments, x their ends (see contact/segment_pair.cpp).
  void follow_pair(const Vec3 (&x)[4]);
  void add_pair_sliding_terms(const Vec3 (&x)[4], bool definite);
  // Gap and normal against the circle of a mouth, and its curvatures (see contact/mouth_edge.cpp).
  void mouth_gap(Vec3 x, double& curvature, Vec3& around, double& across_edge);
  // z at the end of a step whose forces were taken at its start.
  void settle(Vec3 relative);
};

// What holds a point of a tendon back.
struct HeldBack {
  double stiffness = 0;  // all that has a part in it, across the tendon [N/m]
  double inertia = 0;    // of the particles there, over the step's weight squared [N/m]
  double hung = 0;       // of what hangs from the tendon there, likewise [N/m]
};

// Tells sets of keys from each other, as a sum over them (multipliers: FNV-1a of 64 bits, and the golden
// ratio).
inline uint64_t hash_of(const ContactKey& key) {
  uint64_t hash = 14695981039346656037ull;
  for (const int part :
       {static_cast<int>(key.kind), key.tendon, key.feature, key.other, key.other_feature, key.end})
    hash = (hash ^ static_cast<uint32_t>(part)) * 1099511628211ull;
  return (hash ^ hash >> 32) * 0x9e3779b97f4a7c15ull;
}

}  // namespace bt
