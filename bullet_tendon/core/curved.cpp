// Planes of a curved surface, tangential where a feature will be at the end of the step.
//
// A plane that touches where the feature is now leans back by (motion in the step) / R when the feature
// gets where it goes: its normal force then brakes like friction with that coefficient. The curvature
// along the tendon is read from the planes of the neighbouring features, so no further query is made.
#include <algorithm>
#include <cmath>

#include "near.h"

namespace bt {

namespace {

// Whether the planes at both places can be of one smooth stretch of surface.
bool usable(const Entry& e, Vec3 from, double farthest) {
  const double away = norm(e.now.point - from);
  return e.wanted && away > 1e-3 * farthest && away <= farthest;
}

// Of two curvatures the one that is nearer to flat, and flat where they disagree: beside an edge,
// the surface on this side of it is what counts.
double flatter(double a, double b) { return a * b <= 0 ? 0 : std::fabs(a) < std::fabs(b) ? a : b; }

}  // namespace

void lean_ahead(const NearCache& cache, int feature, Vec3 ahead, Vec3& point, Vec3& normal) {
  const int n = static_cast<int>(cache.local.size());
  const int first = feature < n ? 0 : n, last = feature < n ? n - 1 : 2 * n - 2;
  const double spacing =
      norm(cache.local[std::min(feature % n + 1, n - 1)] - cache.local[std::max(feature % n - 1, 0)]);
  double curvature = 0, nearest = spacing;
  Vec3 along;
  bool found = false;
  for (int other : {feature - 1, feature + 1}) {
    if (other < first || other > last || !usable(cache.entries[other], point, spacing)) continue;
    const Entry& e = cache.entries[other];
    const Vec3 away = without(e.now.point - point, normal);
    const double length = norm(away);
    if (length <= 1e-3 * spacing) continue;
    const Vec3 t = (1 / length) * away;
    const double bent = dot(e.now.normal - normal, t) / length;
    curvature = found ? flatter(curvature, bent) : bent;
    if (!found) along = t;
    nearest = std::min(nearest, length);
    found = true;
  }
  const double aside = dot(ahead - point, along), height = dot(ahead - point, normal);
  if (curvature == 0 || 1 + curvature * height <= 0.5) return;
  const double most = std::fabs(curvature) * nearest;
  const double angle = std::min(std::max(std::atan2(curvature * aside, 1 + curvature * height), -most), most);
  const double s = std::sin(angle), c = std::cos(angle);
  point += (s / curvature) * along + (-(1 - c) / curvature) * normal;
  normal = c * normal + s * along;
}

}  // namespace bt
