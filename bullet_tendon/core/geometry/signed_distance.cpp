#include "geometry/signed_distance.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "math/rounding.h"

namespace bt {

namespace {

// The point of a triangle that is nearest to x, and its feature (Ericson 2005, section 5.1.5).
Vec3 nearest_in(Vec3 a, Vec3 b, Vec3 c, Vec3 x, int& feature) {
  const Vec3 ab = b - a, ac = c - a, ax = x - a, bx = x - b, cx = x - c;
  const double d1 = dot(ab, ax), d2 = dot(ac, ax), d3 = dot(ab, bx), d4 = dot(ac, bx), d5 = dot(ab, cx),
               d6 = dot(ac, cx);
  if (d1 <= 0 && d2 <= 0) return feature = 4, a;
  if (d3 >= 0 && d4 <= d3) return feature = 5, b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return feature = 3, a + (d1 / (d1 - d3)) * ab;
  if (d6 >= 0 && d5 <= d6) return feature = 6, c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return feature = 2, a + (d2 / (d2 - d6)) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0)
    return feature = 1, b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b);
  const double all = 1 / (va + vb + vc);
  return feature = 0, a + (vb * all) * ab + (vc * all) * ac;
}

}  // namespace

SignedDistance::SignedDistance(std::vector<Vec3> vertices, std::vector<Indices> triangles)
    : vertices_(std::move(vertices)), triangles_(std::move(triangles)) {
  std::vector<Box> boxes(triangles_.size());
  for (size_t i = 0; i < triangles_.size(); ++i)
    for (int v : triangles_[i]) boxes[i].include(vertices_[v]);
  tree_ = BoxTree(boxes, 1);
  find_features();
}

void SignedDistance::find_features() {
  std::map<std::pair<int, int>, std::pair<Vec3, int>> edges;  // sum of face normals, number of faces
  std::vector<Vec3> corners(vertices_.size());
  std::vector<char> corner_open(vertices_.size(), 0);
  auto edge_of = [](const Indices& t, int k) { return std::minmax(t[(k + 1) % 3], t[(k + 2) % 3]); };
  features_.resize(triangles_.size());
  for (size_t i = 0; i < triangles_.size(); ++i) {
    const Indices& t = triangles_[i];
    const Vec3 p[3] = {vertices_[t[0]], vertices_[t[1]], vertices_[t[2]]};
    const Vec3 face = unit_or(cross(p[1] - p[0], p[2] - p[0]), {0, 0, 1});
    features_[i].face = face;
    for (int k = 0; k < 3; ++k) {
      auto& edge = edges[edge_of(t, k)];
      edge.first += face;
      ++edge.second;
      const Vec3 one = p[(k + 1) % 3] - p[k], other = p[(k + 2) % 3] - p[k];
      corners[t[k]] += std::atan2(norm(cross(one, other)), dot(one, other)) * face;
    }
  }
  for (const auto& [ends, edge] : edges)
    if (edge.second == 1) {
      open_ = true;
      corner_open[ends.first] = corner_open[ends.second] = 1;
    }
  for (size_t i = 0; i < triangles_.size(); ++i)
    for (int k = 0; k < 3; ++k) {
      const auto& edge = edges[edge_of(triangles_[i], k)];
      const int v = triangles_[i][k];
      features_[i].edge[k] = unit_or(edge.first, features_[i].face);
      features_[i].edge_open[k] = edge.second == 1;
      features_[i].corner[k] = unit_or(corners[v], features_[i].face);
      features_[i].corner_open[k] = corner_open[v] != 0;
    }
}

void SignedDistance::measure(int triangle, Vec3 x, Found& best) const {
  const Indices& t = triangles_[triangle];
  int feature;
  const Vec3 point = nearest_in(vertices_[t[0]], vertices_[t[1]], vertices_[t[2]], x, feature);
  const double square = dot(x - point, x - point);
  // Of several triangles at the same distance the first counts, so that the order of the search does not.
  if (square < best.square || (square == best.square && triangle < best.triangle))
    best = {square, (1 + kRoundingShare) * std::sqrt(square), point, triangle, feature};
}

double SignedDistance::operator()(Vec3 x) const {
  int triangle = 0;
  return operator()(x, triangle);
}

double SignedDistance::operator()(Vec3 x, int& triangle) const {
  Found best{HUGE_VAL, HUGE_VAL, {}, -1, 0};
  measure(triangle, x, best);
  tree_.visit({x, x}, best.reach, [&](int k) { measure(tree_.order()[k], x, best); });
  triangle = best.triangle;
  const Features& f = features_[best.triangle];
  const int k = (best.feature + 2) % 3;  // of an edge (1 to 3) or a corner (4 to 6)
  const bool is_edge = best.feature >= 1 && best.feature <= 3, is_corner = best.feature >= 4;
  const Vec3 normal = is_edge ? f.edge[k] : is_corner ? f.corner[k] : f.face;
  const bool border = is_edge ? f.edge_open[k] : is_corner ? f.corner_open[k] : false;
  const Vec3 v = x - best.point;
  const double height = dot(normal, v);
  if (border) return height + norm(v - height * normal);
  return height < 0 ? -std::sqrt(best.square) : std::sqrt(best.square);
}

Box SignedDistance::box(double depth) const {
  Box box = tree_.box();
  for (size_t i = 0; open_ && i < triangles_.size(); ++i)
    for (int v : triangles_[i]) box.include(vertices_[v] - depth * features_[i].face);
  return box;
}

double SignedDistance::volume() const {
  double sum = 0;
  for (const Indices& t : triangles_)
    sum += dot(vertices_[t[0]], cross(vertices_[t[1]], vertices_[t[2]])) / 6;
  return sum;
}

}  // namespace bt
