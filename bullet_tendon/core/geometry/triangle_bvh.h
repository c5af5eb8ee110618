// The triangles of a bone, and which of them a feature can be nearest to while it moves.
//
// A query tells the distance d of a feature. Where every triangle nearer than d + 2 m is listed, those are
// the only ones that can be nearest as long as the feature has moved by no more than m: any other is at least
// d + m away, and the nearest at most that. So until then the list answers as exactly as another query.
//
// Once it has moved by more, the tree is searched anew, from where the distance to what was nearest bounds
// it.
//
// Of each listed triangle it keeps the plane that separated it from the feature, across their nearest points:
// both are convex, so the feature's height over it stays a lower bound of the distance wherever the feature
// goes. Only triangles whose bound is under the nearest distance found are measured.
#pragma once
#include <cstdint>
#include <vector>

#include "geometry/box_tree.h"

namespace bt {

struct Triangle {
  Vec3 a, b, c;
};

// A triangle of a list: n.x <= c on it, and >= c + distance on the feature when the list was made.
struct Nearby {
  int triangle = 0;
  double distance = 0;  // [m]
  Vec3 n;
  double c = 0;
};

// The nearest points of a segment and a surface: at u on the segment.
struct Nearest {
  double distance = 0, u = 0;
  Vec3 point;
};

// Of the triangle, to a segment a-b that does not cross it; a = b is a point.
Nearest nearest_of(const Triangle& t, Vec3 a, Vec3 b);

// How the surface goes on at the point of a triangle that is nearest to a feature.
struct Slope {
  Vec3 normal;            // of the plane that the feature stays above
  bool concave = false;   // the point is at an edge that is concave
  bool leads_on = false;  // it is at an edge where the surface goes on to a triangle that is nearer
};

// A side of a valley: its nearest point, and the normal of the plane that the feature stays above.
struct ValleySide {
  Nearest nearest;
  Vec3 normal;
};

class Surface {
 public:
  explicit Surface(const std::vector<Triangle>& triangles);
  // Lists the triangles within reach of a segment, the kMostNearby nearest of them at most; one that the
  // segment crosses is at the distance 0. Returns the distance below which none is missing [m].
  double list(Vec3 a, Vec3 b, double reach, std::vector<Nearby>& out) const;
  // The nearest point of those listed.
  Nearest nearest(const std::vector<Nearby>& listed, Vec3 a, Vec3 b) const;
  // The nearest point of all, no farther than `within` by what is known already [m]. Where the segment
  // crosses the surface, or all but touches it: a distance of 0.
  Nearest search(Vec3 a, Vec3 b, double within) const;
  // The nearest point of those listed, within reach of the segment a-b, on another side of a valley of the
  // surface. One side has the point `on`, and `out` leads from it to the point that it is nearest to. A
  // distance beyond reach: there is none.
  ValleySide across_valley(const std::vector<Nearby>& listed, Vec3 a, Vec3 b, Vec3 on, Vec3 out,
                           double reach) const;
  // Whether the way from one point to another leads through the surface.
  bool is_between(Vec3 from, Vec3 to) const;
  // In no order.
  const std::vector<Triangle>& triangles() const { return triangles_; }
  // Tells surfaces apart.
  uint64_t mark() const { return mark_; }

 private:
  // The nearest point of triangle k, at the distance 0 where the segment crosses it.
  Nearest measure(int k, Vec3 a, Vec3 b) const;
  // `out`: from that point to the feature a-b.
  Slope slope_at(const std::vector<Nearby>& listed, int triangle, const Nearest& at, Vec3 out, Vec3 a,
                 Vec3 b) const;
  void list_triangle(int k, Vec3 a, Vec3 b, double& reach, std::vector<Nearby>& out) const;
  std::vector<Triangle> triangles_;  // in the order of the tree
  BoxTree tree_;
  double size_ = 0;                          // [m]
  uint64_t mark_ = 14695981039346656037ull;  // FNV-1a over the triangles
};

}  // namespace bt
