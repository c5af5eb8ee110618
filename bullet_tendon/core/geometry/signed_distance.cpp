#include "geometry/signed_distance.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "math/rotation.h"

namespace bt {

namespace {

// Share of a squared distance by which that of a group may be too large: its roundings, and those of
// triangles that are a million times longer than wide.
constexpr double kRounding = 1e-6;

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
  build(0, static_cast<int>(triangles_.size()));
  fill_groups();
  find_features();
}

int SignedDistance::build(int first, int count) {
  const int at = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  Box box, middles;
  Vec3 normals;
  auto middle = [&](const Indices& t) { return vertices_[t[0]] + vertices_[t[1]] + vertices_[t[2]]; };
  for (int i = first; i < first + count; ++i) {
    const Indices& t = triangles_[i];
    for (int v : t) box.include(vertices_[v]);
    middles.include(middle(t));
    normals += cross(vertices_[t[1]] - vertices_[t[0]], vertices_[t[2]] - vertices_[t[0]]);
  }
  Node node;
  node.box = box;
  node.normal = unit_or(normals, {0, 0, 1});
  node.low = HUGE_VAL;
  node.high = -HUGE_VAL;
  for (int i = first; i < first + count; ++i)
    for (int v : triangles_[i]) {
      const double height = dot(node.normal, vertices_[v]);
      node.low = std::min(node.low, height);
      node.high = std::max(node.high, height);
    }
  if (count <= kLanes) {
    node.group = first / kLanes;
    nodes_[at] = node;
    return at;
  }
  const Vec3 size = middles.hi - middles.lo;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  auto along = [&](const Indices& t) { return dot(middle(t), unit_axis(axis)); };
  const int half = (count / kLanes + 1) / 2 * kLanes;  // of whole groups
  std::nth_element(triangles_.begin() + first, triangles_.begin() + first + half,
                   triangles_.begin() + first + count,
                   [&](const Indices& s, const Indices& t) { return along(s) < along(t); });
  build(first, half);
  node.second = build(first + half, count - half);
  nodes_[at] = node;
  return at;
}

void SignedDistance::fill_groups() {
  const int count = static_cast<int>(triangles_.size());
  groups_.resize((count + kLanes - 1) / kLanes);
  for (int i = 0; i < static_cast<int>(groups_.size()) * kLanes; ++i) {
    const Indices& t = triangles_[std::min(i, count - 1)];
    const Vec3 a = vertices_[t[0]], one = vertices_[t[1]] - a, other = vertices_[t[2]] - a;
    Group& group = groups_[i / kLanes];
    auto put = [&](Eight* to, Vec3 v) {
      to[0][i % kLanes] = v.x;
      to[1][i % kLanes] = v.y;
      to[2][i % kLanes] = v.z;
    };
    put(group.corner, a);
    put(group.one, one);
    put(group.other, other);
  }
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
  if (square < best.square) best = {square, point, triangle, feature};
}

BT_WITHIN inline double SignedDistance::square_to(const Node& node, Vec3 x) {
  const Vec3 off = highest(highest(node.box.lo - x, x - node.box.hi), Vec3{});
  const double height = dot(node.normal, x);
  const double beyond = std::max(0.0, std::max(node.low - height, height - node.high));
  return std::max(beyond * beyond, dot(off, off));
}

BT_WITHIN inline void dot(const Eight* a, const Eight* b, Eight& out) {
  out = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Makes `least` the squared distance of x to an edge where that is less: from that of x to the edge's start,
// the edge's squared length, and its product with the way from there.
BT_WITHIN inline void take_edge(const Eight& to_start, const Eight& length, const Eight& along,
                                Eight& least) {
  const Eight zero{}, one = zero + 1.0;
  Eight share = along / length;
  share = share < zero ? zero : share;
  share = share > one ? one : share;
  const Eight square = to_start + share * (share * length - 2.0 * along);
  least = square < least ? square : least;
}

// Squared distances of x to the triangles of a group: to the plane above the inside, else to the nearest of
// the three edges.
BT_WITHIN inline void squares_to(const SignedDistance::Group& group, Vec3 x, Eight& squares) {
  const Eight r[3] = {x.x - group.corner[0], x.y - group.corner[1], x.z - group.corner[2]};
  const Eight *e = group.one, *f = group.other;
  Eight ee, ef, ff, er, fr, rr;
  dot(e, e, ee);
  dot(e, f, ef);
  dot(f, f, ff);
  dot(e, r, er);
  dot(f, r, fr);
  dot(r, r, rr);
  squares = rr;
  take_edge(rr, ee, er, squares);
  take_edge(rr, ff, fr, squares);
  take_edge(rr - 2.0 * er + ee, ee - 2.0 * ef + ff, fr - er - ef + ee, squares);
  const Eight n[3] = {e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]};
  Eight height;
  dot(n, r, height);
  const Eight det = ee * ff - ef * ef, s = ff * er - ef * fr, w = ee * fr - ef * er;
  const auto inside = (s >= 0.0) & (w >= 0.0) & (s + w <= det);
  squares = inside ? height * height / det : squares;
}

BT_VECTOR void search(const SignedDistance& mesh, Vec3 x, SignedDistance::Found& best) {
  struct Open {
    int node;
    double square;
  };
  Open open[64];
  int count = 0;
  open[count++] = {0, SignedDistance::square_to(mesh.nodes_[0], x)};
  while (count > 0) {
    const Open at = open[--count];
    if (at.square >= best.square) continue;
    const SignedDistance::Node& node = mesh.nodes_[at.node];
    if (node.group >= 0) {
      Eight squares;
      squares_to(mesh.groups_[node.group], x, squares);
      for (int lane = 0; lane < kLanes; ++lane)
        if (squares[lane] * (1 - kRounding) < best.square) {
          const int triangle = node.group * kLanes + lane;
          if (triangle < static_cast<int>(mesh.triangles_.size())) mesh.measure(triangle, x, best);
        }
      continue;
    }
    Open near{at.node + 1, SignedDistance::square_to(mesh.nodes_[at.node + 1], x)};
    Open far{node.second, SignedDistance::square_to(mesh.nodes_[node.second], x)};
    if (near.square > far.square) std::swap(near, far);
    if (far.square < best.square) open[count++] = far;
    if (near.square < best.square) open[count++] = near;
  }
}

double SignedDistance::operator()(Vec3 x) const {
  int triangle = 0;
  return operator()(x, triangle);
}

double SignedDistance::operator()(Vec3 x, int& triangle) const {
  Found best{HUGE_VAL, {}, -1, 0};
  measure(triangle, x, best);
  search(*this, x, best);
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
  Box box = nodes_[0].box;
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
