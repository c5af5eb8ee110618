// Which particles and segments of a tendon need a distance to a bone, and what was last answered.
//
// A feature is a particle or the inside of a segment. Its entry has the plane of the last measurement (point
// and normal on the shape, in the shape's frame) and where the feature was then. With d the distance then,
// and m the motion since, relative to the shape, the feature is
//   skipped  while d - m > reach, because it cannot have come within reach,
//   reused   while the list of triangles that were near then contains the nearest one
//            (geometry/triangle_bvh.h): these triangles are measured again. Of a primitive, while the error
//            of the plane is below the reuse tolerance,
//   searched for its nearest triangle, whose distance the last one bounds,
//   queried  otherwise: where nothing is known, or the feature crosses the surface or has passed through it.
//            Primitives are measured by closed forms here (geometry/primitive_distance.h).
// All of this is checked against the feature's present place. Therefore entries are not put back where a step
// is.
//
// The distance to a convex primitive at a displacement from distance d is at least the plane's value. With m
// the part of the displacement along the plane, and d' >= d - |displacement| the plane's value there, it is
// at most sqrt(d'^2 + m^2) - d' <= m^2/(2 d') more. Hence reuse up to m = sqrt(2 d' tolerance). The normal
// lags behind by up to sqrt(2 tolerance/d') while a feature slides, and for some steps after. What rests on a
// curved primitive rests on a plane that stands still; measured in each step, it would go on trembling by
// about 1e-6 m/s.
#pragma once
#include <vector>

#include "collision/shape.h"
#include "tendon/tendon.h"

namespace bt {

// Within a part of a step, what is near something moves by at most this share of the radius (of both
// radii, for two tendons) relative to it [-]: a centreline that starts outside then cannot get through,
// wherever the nearest points go. Larger: it can. Smaller: more parts.
constexpr double kFarthestMove = 0.9;

// What a bound on a distance is enlarged by, so that what it was taken from is within it [-].
constexpr double kRoundedUp = 1e-9;

// Where a feature is nearest to a shape.
struct Plane {
  Vec3 point, normal;  // shape frame
  double u = 0;        // nearest point of a segment
  bool hole = false;   // the surface there lies in a bore: it has been drilled away
};

struct Entry {
  bool known = false;    // a plane was answered once
  bool inside = false;   // the last answer found the centreline inside the shape
  bool wanted = false;   // it is within reach, and a row is to be made in this step
  double distance = 0;   // of the last query [m]
  double clearance = 0;  // least distance of the centreline now [m]
  double motion = 0;     // of the feature in this step, relative to the shape [m]
  double reach = 0;      // how near it has to be for that to matter [m]
  int age = 0;           // how often the plane was reused by a feature that had moved since
  Plane asked, now;      // of the last query, and to be used in this step
  Vec3 a, b;             // the feature's ends at the last query, shape frame
  double listed = 0;     // how far away the surface's triangles then were, up to which they are listed [m]
  std::vector<Nearby> nearby;  // the list; empty: to be made
};

struct Query {
  int tendon, shape, feature;  // feature: particle i, or n + k for segment k
  Vec3 a, b;                   // shape frame
};

struct NearCounts {
  long considered = 0, culled = 0, skipped = 0, reused = 0, searched = 0, queried = 0;
  long tunnels = 0,
       tunnels_culled = 0;  // pairs of tendons and tunnels, and those of them that are too far apart
};

struct NearCache {
  std::vector<Entry> entries;  // n particles, then n - 1 segments; empty until the shape was near
  std::vector<Vec3> local;     // particles in the shape's frame
  std::vector<double> motion;  // of particles in this step, relative to the shape, as foreseen [m]
};

struct NearContext {
  double dt = 0, threshold = 0, reuse_tolerance = 0;
  const std::vector<Bore>* bores = nullptr;  // those of the shape's link
};

// Appends the queries needed for one tendon and one shape, and marks the entries that are to make rows.
void ask(const Tendon& tendon, int tendon_slot, const Shape& shape, int shape_slot, const Link& link,
         const NearContext& context, NearCache& cache, std::vector<Query>& queries, NearCounts& counts);

// Takes the answer to a query: distance, nearest surface point (shape frame) and parameter. Where there is a
// surface, the core's own arithmetic refines it, the same as between queries.
void answer(const Query& query, double distance, Vec3 point, double u, const Shape& shape, const Pose& pose,
            const std::vector<Bore>& bores, Entry& entry);

// Share of a step that something can go which is `clearance` away from a centreline of this radius, and
// moves by `motion` relative to it [-]: until it could touch, or by kFarthestMove.
double safe_fraction(double clearance, double radius, double motion);
// The smallest of those shares, of all features that are near the shape.
double motion_limit_of(const NearCache& cache, double radius);

// Moves a plane along the surface (shape frame), as curved as the planes of the neighbouring features say, to
// where the feature will be.
void lean_ahead(const NearCache& cache, int feature, Vec3 ahead, Vec3& point, Vec3& normal);

// Motion of a particle within the step relative to a link, as foreseen [m].
double motion_of(const Tendon& tendon, int particle, const Link& link, double dt);
// How far a feature's end can come towards a body within the step [m].
double reach_of(const Tendon& tendon, int particle, const Link& link, double dt, double threshold);

}  // namespace bt
