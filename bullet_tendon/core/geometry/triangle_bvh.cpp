#include "geometry/triangle_bvh.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/segment_distance.h"
#include "math/rounding.h"

namespace bt {

namespace {

// Most triangles of a list [-]; where there are more, it is for less motion. Larger: lists cost more.
// Smaller: more queries.
constexpr size_t kMostNearby = 64;

// Least height of a point over the tangent plane of another, over their distance from the feature, from which
// the surface between them is a valley [-]. Larger: flat valleys have one side at a time, between which what
// slides changes. Smaller: more contacts on rough surfaces.
constexpr double kValley = 1e-4;

Box box_of(const Triangle& t) {
  Box box;
  box.include(t.a);
  box.include(t.b);
  box.include(t.c);
  return box;
}

Box box_of(Vec3 a, Vec3 b) {
  Box box;
  box.include(a);
  box.include(b);
  return box;
}

// Whether a segment passes beside a box, by more than a margin: an axis of the box, or one across both,
// separates them.
bool is_beside(const Box& box, Vec3 from, Vec3 to, double margin) {
  const Vec3 half = 0.5 * (box.hi - box.lo) + Vec3{margin, margin, margin};
  const Vec3 d = 0.5 * (to - from), c = 0.5 * (from + to) - box.middle(), moment = cross(d, c);
  const Vec3 h{std::fabs(d.x), std::fabs(d.y), std::fabs(d.z)};
  return std::fabs(c.x) > half.x + h.x || std::fabs(c.y) > half.y + h.y || std::fabs(c.z) > half.z + h.z ||
         std::fabs(moment.x) > half.y * h.z + half.z * h.y ||
         std::fabs(moment.y) > half.z * h.x + half.x * h.z ||
         std::fabs(moment.z) > half.x * h.y + half.y * h.x;
}

// Whether p lies over the inside of the triangle, and the foot of its perpendicular there: its barycentric
// coordinates in the triangle's plane, from the squares and products of two edges.
bool above(const Triangle& t, Vec3 p, Vec3& foot) {
  const Vec3 e = t.b - t.a, f = t.c - t.a, r = p - t.a;
  const double ee = dot(e, e), ef = dot(e, f), ff = dot(f, f), er = dot(e, r), fr = dot(f, r);
  const double det = ee * ff - ef * ef, s = ff * er - ef * fr, w = ee * fr - ef * er;
  if (det <= 0 || s < 0 || w < 0 || s + w > det) return false;
  foot = t.a + (s / det) * e + (w / det) * f;
  return true;
}

// Perpendicular to the triangle, as long as twice its area [m^2].
Vec3 area_of(const Triangle& t) { return cross(t.b - t.a, t.c - t.a); }

// Whether a segment goes through the triangle, or touches it: its ends are on both sides, and so is it of no
// edge (the volumes of its tetrahedra with the edges have one sign).
bool is_pierced(const Triangle& t, Vec3 a, Vec3 b) {
  const Vec3 n = area_of(t), d = b - a;
  const double over = dot(n, a - t.a), under = dot(n, b - t.a);
  if (over * under > 0 || (over == 0 && under == 0)) return false;
  const Vec3 p = t.a - a, q = t.b - a, r = t.c - a;
  const double u = dot(d, cross(p, q)), v = dot(d, cross(q, r)), w = dot(d, cross(r, p));
  return (u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0);
}

// Squared distances, while they are only compared.
void take_nearer(Nearest& best, Vec3 on_segment, double u, Vec3 point) {
  const Vec3 apart = on_segment - point;
  const double square = dot(apart, apart);
  if (square < best.distance) best = {square, u, point};
}

bool nearer(const Nearby& a, const Nearby& b) { return a.distance < b.distance; }

Nearest rooted(Nearest n) { return {std::sqrt(n.distance), n.u, n.point}; }

Nearest nearest_to_point(const Triangle& t, Vec3 p) {
  Vec3 foot;
  Nearest best{1e300, 0, {}};
  if (above(t, p, foot)) return take_nearer(best, p, 0, foot), rooted(best);
  const Vec3 corner[4] = {t.a, t.b, t.c, t.a};
  for (int k = 0; k < 3; ++k) {
    const Vec3 e = corner[k + 1] - corner[k];
    const double ee = dot(e, e), w = ee > 0 ? dot(p - corner[k], e) / ee : 0;
    take_nearer(best, p, 0, corner[k] + std::min(1.0, std::max(0.0, w)) * e);
  }
  return rooted(best);
}

}  // namespace

Nearest nearest_of(const Triangle& t, Vec3 a, Vec3 b) {
  if (a.x == b.x && a.y == b.y && a.z == b.z) return nearest_to_point(t, a);
  Nearest best{1e300, 0, {}};
  Vec3 foot;
  if (above(t, a, foot)) take_nearer(best, a, 0, foot);
  if (above(t, b, foot)) take_nearer(best, b, 1, foot);
  const Vec3 corner[4] = {t.a, t.b, t.c, t.a};
  for (int k = 0; k < 3; ++k) {
    const auto [u, w] = nearest_parameters(a, b, corner[k], corner[k + 1]);
    take_nearer(best, (1 - u) * a + u * b, u, (1 - w) * corner[k] + w * corner[k + 1]);
  }
  return rooted(best);
}

Surface::Surface(const std::vector<Triangle>& triangles) {
  std::vector<Box> boxes;
  for (const Triangle& t : triangles) boxes.push_back(box_of(t));
  tree_ = BoxTree(boxes, 1);
  for (const int k : tree_.order()) triangles_.push_back(triangles[k]);
  if (!triangles_.empty()) size_ = norm(tree_.box().hi - tree_.box().lo);
  const auto* bytes = reinterpret_cast<const unsigned char*>(triangles.data());
  for (size_t k = 0; k < triangles.size() * sizeof(Triangle); ++k)
    mark_ = (mark_ ^ bytes[k]) * 1099511628211ull;
}

double Surface::list(Vec3 a, Vec3 b, double reach, std::vector<Nearby>& out) const {
  out.clear();
  tree_.visit(box_of(a, b), reach, [&](int k) { list_triangle(k, a, b, reach, out); });
  std::sort(out.begin(), out.end(), [](const Nearby& p, const Nearby& q) { return p.triangle < q.triangle; });
  return reach;
}

Nearest Surface::search(Vec3 a, Vec3 b, double within) const {
  // The bound has the rounding of coordinates, which next to the surface is larger than a share of it.
  Nearest best{within + kRoundingShare * size_, 0, {}};
  tree_.visit(box_of(a, b), best.distance, [&](int k) {
    const Nearest found = measure(k, a, b);
    if (found.distance <= best.distance) best = found;
  });
  return best.distance <= kRoundingShare * size_ ? Nearest{} : best;
}

namespace {

// An edge of a triangle, and the corner that is not on it.
struct Edge {
  Vec3 from, to, third;
  Vec3 along() const { return unit_or(to - from, {}); }
  // In the plane of the triangle, out of it.
  Vec3 away() const { return unit_or(without(from - third, along()), {}); }
};

// The edges of a triangle that a point of it is on.
template <class Do>
void each_edge_at(const Triangle& t, Vec3 point, double rounding, Do what) {
  const Vec3 corners[] = {t.a, t.b, t.c};
  for (int k = 0; k < 3; ++k) {
    const Edge edge{corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]};
    if (norm(without(point - edge.from, edge.along())) <= rounding) what(edge);
  }
}

bool has_edge(const Triangle& t, const Edge& edge, double rounding) {
  const Vec3 middle = 0.5 * (edge.from + edge.to), area = area_of(t);
  if (std::fabs(dot(area, middle - t.a)) > rounding * norm(area)) return false;  // is decided soonest
  return nearest_of(t, middle, middle).distance <= rounding;
}

}  // namespace

// At a concave edge the surface goes on upwards. There its plane leans no farther than the triangle does,
// wherever the feature is: beyond the edge it is above both triangles.
Slope Surface::slope_at(const std::vector<Nearby>& listed, int triangle, const Nearest& at, Vec3 out, Vec3 a,
                        Vec3 b) const {
  const double rounding = kRoundingShare * size_;
  const Triangle& t = triangles_[triangle];
  Vec3 face = unit_or(area_of(t), {});
  if (dot(face, out) < 0) face = -face;
  Slope slope{out, false, false};
  each_edge_at(t, at.point, rounding, [&](const Edge& edge) {
    const Vec3 away = edge.away();
    for (const Nearby& near : listed) {
      const Triangle& other = triangles_[near.triangle];
      if (near.triangle == triangle || !has_edge(other, edge, rounding)) continue;
      auto height = [&](Vec3 p) { return dot(p - edge.from, face); };
      if (std::max({height(other.a), height(other.b), height(other.c)}) <= rounding) {
        slope.leads_on |= nearest_of(other, a, b).distance < at.distance - rounding;
      } else if (dot(slope.normal, away) > 0) {
        slope.normal = unit_or(without(slope.normal, away), face);
        slope.concave = true;
      }
    }
  });
  return slope;
}

ValleySide Surface::across_valley(const std::vector<Nearby>& listed, Vec3 a, Vec3 b, Vec3 on, Vec3 out,
                                  double reach) const {
  const Vec3 up = unit_or(out, {});
  const double least = kValley * norm(out), rounding = kRoundingShare * size_;
  auto height = [&](Vec3 p) { return dot(p - on, up); };
  const bool segment = norm(b - a) > 0;
  ValleySide best{{2 * reach, 0, {}}, {}};
  double rise = 1;  // sine of the way to the feature over the best plane
  for (const Nearby& near : listed) {
    const Triangle& t = triangles_[near.triangle];
    if (std::max({height(t.a), height(t.b), height(t.c)}) <= least) continue;
    const Nearest found = nearest_of(t, a, b);
    if (found.distance > reach || found.distance > best.nearest.distance + rounding) continue;
    if (height(found.point) <= -rounding) continue;
    const Vec3 there = unit_or((1 - found.u) * a + found.u * b - found.point, {});
    const Slope slope = slope_at(listed, near.triangle, found, there, a, b);
    // Each point above the tangent plane of the other: the surface is concave between them. The point at a
    // concave edge can be on both sides.
    if (height(found.point) <= (slope.concave ? -rounding : least)) continue;
    if (dot(on - found.point, slope.normal) <= least) continue;
    // Where the surface goes on to a nearer triangle, the edge has no tangent plane. A particle keeps that
    // plane all the same: it can be thrown over the edge in one step. The interior of a segment would be
    // pushed aside by it.
    if (segment && slope.leads_on) continue;
    // At a corner several triangles have the same point. The plane that the feature is least above counts.
    const bool nearer = found.distance < best.nearest.distance - rounding;
    if (nearer || dot(there, slope.normal) < rise) {
      best = {found, slope.normal};
      rise = dot(there, slope.normal);
    }
  }
  return best;
}

bool Surface::is_between(Vec3 from, Vec3 to) const {
  if (triangles_.empty()) return false;
  bool found = false;
  tree_.each([&](const Box& box) { return found || is_beside(box, from, to, kRoundingShare * size_); },
             [&](int k) { found = found || is_pierced(triangles_[k], from, to); });
  return found;
}

Nearest Surface::measure(int k, Vec3 a, Vec3 b) const {
  Nearest found = nearest_of(triangles_[k], a, b);
  if (is_pierced(triangles_[k], a, b)) found.distance = 0;
  return found;
}

// Of more than are kept, the nearest; `reach` then ends where the farthest of them is.
void Surface::list_triangle(int k, Vec3 a, Vec3 b, double& reach, std::vector<Nearby>& out) const {
  const Nearest found = measure(k, a, b);
  if (found.distance > reach) return;
  if (out.size() == kMostNearby) {
    std::pop_heap(out.begin(), out.end(), nearer);
    out.pop_back();
  }
  const Vec3 n = unit_or((1 - found.u) * a + found.u * b - found.point, {});
  out.push_back({k, found.distance, n, dot(n, found.point)});
  std::push_heap(out.begin(), out.end(), nearer);
  if (out.size() == kMostNearby) reach = out.front().distance;
}

Nearest Surface::nearest(const std::vector<Nearby>& listed, Vec3 a, Vec3 b) const {
  auto bound = [&](const Nearby& near) { return std::min(dot(near.n, a), dot(near.n, b)) - near.c; };
  size_t likely = 0;
  double least = 1e300;
  for (size_t k = 0; k < listed.size(); ++k) {
    const double here = bound(listed[k]);
    if (here < least) {
      least = here;
      likely = k;
    }
  }
  Nearest best{1e300, 0, {}};
  if (!listed.empty()) best = nearest_of(triangles_[listed[likely].triangle], a, b);
  for (size_t k = 0; k < listed.size(); ++k) {
    if (k == likely || bound(listed[k]) >= best.distance) continue;
    const Nearest here = nearest_of(triangles_[listed[k].triangle], a, b);
    if (here.distance < best.distance) best = here;
  }
  return best;
}

}  // namespace bt
