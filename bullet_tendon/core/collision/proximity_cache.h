// Decides which particles and segments of a tendon need a new distance to a bone, and keeps the last
// distances.
//
// A feature is a particle or the inside of a segment, or the part of it that can touch the shape
// (touching_part). Its entry has the plane of the last query (point and normal on the shape, in the shape's
// frame) and the position of the feature at that query. With d the distance at that query, and m the motion
// since then relative to the shape, the feature is
//   skipped  while d - m > reach, because it cannot be within reach,
//   reused   mesh: while the list of the nearby triangles of the last query contains the nearest one
//            (geometry/triangle_bvh.h); these triangles are measured again. Primitive on a link at rest:
//            while the error of the plane is below the reuse tolerance. A link that rolls along a segment
//            leaves the nearest point of the last query behind,
//   searched mesh: for the nearest triangle; the distance to the last nearest point is an upper bound. A mesh
//            with bores is what they leave of it, which FCL does not know: it is always searched,
//   queried  otherwise: where nothing is known, or the feature crosses the surface or has passed through it.
//            Primitives are measured in closed form here (geometry/primitive_distance.h). Of a mesh, FCL
//            measures the particles first. Segments of which nothing is known are then searched: the
//            distances to the nearest points of their ends are upper bounds.
// All conditions use the present position of the feature. Therefore entries are not restored with a step.
//
// After a displacement from distance d, the distance to a convex primitive is at least the height d' over the
// plane, d' >= d - |displacement|. With m the part of the displacement along the plane, the distance exceeds
// d' by at most sqrt(d'^2 + m^2) - d' <= m^2/(2 d'). Hence reuse up to m = sqrt(2 d' tolerance). The error of
// the normal is up to sqrt(2 tolerance/d') while a feature slides and where it stops. A feature at rest on a
// curved primitive rests on a fixed plane. With a measurement in each step it would vibrate with about 1e-6
// m/s.
#pragma once
#include <vector>

#include "collision/narrow_phase.h"
#include "collision/shape.h"
#include "tendon/tendon.h"

namespace bt {

// Greatest relative motion of near features within a substep, in radii (of two tendons: in sums of radii)
// [-]. A centreline that starts outside then cannot pass through, wherever the nearest points move. Larger:
// it can. Smaller: more substeps.
constexpr double kFarthestMove = 0.9;

// Tangent plane of a shape at the point nearest to a feature.
struct Plane {
  Vec3 point, normal;  // shape frame
  double u = 0;        // parameter of the nearest point of the whole segment [-]
  bool hole = false;   // of a primitive: the surface point is in a bore, where there is no bone
};

struct Entry {
  bool known = false;          // a plane is known
  bool inside = false;         // at the last query the centreline was inside the shape
  bool wanted = false;         // within reach: a contact is built in this step
  double distance = 0;         // at the last query [m]
  double clearance = 0;        // lower bound of the centreline's present distance [m]
  double reach = 0;            // greatest distance at which contact is possible in this step [m]
  Plane asked, now;            // of the last query, and of this step
  Vec3 a, b;                   // the feature's ends at the last query, shape frame
  double listed = 0;           // distance at the last query up to which all triangles are listed [m]
  std::vector<Nearby> nearby;  // the listed triangles; empty: not listed yet
};

struct Query {
  int tendon, shape, feature;  // feature: particle i, or n + k for segment k
  Vec3 a, b;                   // shape frame
  Stretch of{};                // the part of the segment that is from a to b
};

// What one detection measures.
struct Queries {
  std::vector<Query> by_oracle;
  std::vector<Query> from_ends;  // segments, after their ends

  void clear();
};

struct NearCounts {
  long considered = 0, culled = 0, skipped = 0, reused = 0, searched = 0, queried = 0;
  long tunnels = 0,
       tunnels_culled = 0;  // pairs of a tendon and a tunnel, and those too far apart
};

// On which side of a closed mesh a point is: its signed distance [m], which no nearer point differs from in
// sign.
struct Side {
  Vec3 at;  // shape frame [m]
  double distance = 0;
};

struct NearCache {
  std::vector<Entry> entries;  // n particles, then n - 1 segments; empty until the shape is near
  std::vector<Vec3> local;     // particles, shape frame [m]
  std::vector<Vec3> way;       // predicted, of particles in this step relative to the shape, shape frame [m]
  std::vector<char> buried;    // particles of insertions in the shape, in this step; empty: none
  std::vector<Side> sides;     // of particles, of which it was asked last; empty: it never was
  std::vector<Departure> departures;  // of the tendon from the shape
};

// Box around all that a tendon can touch in the substep, if what it touches rests [m].
Box box_of_reach(const Tendon& tendon, double threshold);

struct NearContext {
  double threshold = 0, reuse_tolerance = 0;  // [m]
  Box reach;                                  // of the tendon, see box_of_reach [m]
  const std::vector<Bore>* bores = nullptr;   // those of the shape's link
  const Surface* surface = nullptr;           // of a mesh: what these bores leave of it; else null
  const std::vector<Link>* links = nullptr;
  // Where there are bores: features that the shape pressed on in the last step, in ascending order.
  const std::vector<int>* pressed = nullptr;
};

// Appends the queries needed for one tendon and one shape, and marks the entries that need contacts.
void ask(const Tendon& tendon, int tendon_slot, const Shape& shape, int shape_slot,
         const NearContext& context, NearCache& cache, Queries& queries, NearCounts& counts);

// Stores the answer to a query: distance [m], nearest surface point (shape frame) and parameter. For a mesh,
// the distance to the listed triangles replaces it, as between queries. pose: of the shape.
void answer(const Query& query, double distance, Vec3 point, double u, const Pose& pose,
            const NearContext& context, Entry& entry);
// Measures a segment near a mesh, of which only its ends are known.
void measure_from_ends(const Query& query, const Surface& surface, NearCache& cache);

// Marks the insertions of a tendon in a mesh, and lets them make no contact: the particles inside of the mesh
// from an attachment to its link on, and the segments with an end inside. Triangles repel on both sides, so
// that they would hold the tendon in the bone. A particle in a bore is outside.
void leave_out_insertions(const Tendon& tendon, const Shape& shape, const std::vector<Bore>& bores,
                          NearCache& cache);

// Lets the list of the triangles near a feature with the ends a and b (shape frame) hold all that are within
// reach of it [m].
void list_within_reach(Entry& entry, Vec3 a, Vec3 b, const Surface& surface);

// Share of a step that is safe for a feature at the distance `clearance` [m] from a centreline of this radius
// [m], with the relative motion `motion` [m]: until they could touch, or move by kFarthestMove radii [-].
double safe_fraction(double clearance, double radius, double motion);
// The smallest of these shares of all features near the shape [-]. Two kinds of ways past a convex primitive
// are safe however long they are: over one face of a box, whose plane holds the feature as a half-space does;
// and one that ends beyond reach of the plane at the nearest point, which separates the feature from the
// shape. Along other ways the contact's plane would be that of another place.
double motion_limit_of(const NearCache& cache, const Shape& shape, const Tendon& tendon);

// A surface beside a feature: a plane, or round (shape frame).
struct Tangent {
  Vec3 point, normal;  // [m], [-]
  Vec3 axis;           // of a cylinder, a unit vector; zero: of a sphere
  double radius = 0;   // of these [m]; 0: a plane
  double share = 1;    // of the segment that is beside the round surface [-]
};

// The surface at the predicted position `ahead` of a feature (shape frame). A segment over a round primitive
// has the round surface itself, along which its contact point follows. A particle beside a box has the plane
// at the point that is nearest to it there: an edge that passes over it would be held back by the plane of
// the start. Other features have the plane that is tangent there; the curvature follows from the planes of
// the neighbouring features.
Tangent tangent_of(const NearCache& cache, const Shape& shape, int feature, Vec3 ahead);

// Predicted motion of a particle within the step, relative to what is foreseen of a link [m].
double motion_of(const Tendon& tendon, int particle, const Link& link);
// Greatest distance to a link at which a particle can touch it within the step [m].
double reach_of(const Tendon& tendon, int particle, const Link& link, double threshold);

}  // namespace bt
