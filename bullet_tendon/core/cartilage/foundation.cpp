#include "cartilage/foundation.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "geometry/bounds.h"

namespace bt {

namespace {

constexpr int kLeaf = 8;             // points of the smallest sets at most [-]
constexpr double kTurn = 1.0 / 3.0;  // components of normals that differ by this count as a resolution [-]

// Centre and scaled normal: what has to be near to each other in a patch.
using Feature = std::array<double, 6>;

struct Merger {
  const FoundationSurface& triangles;
  const std::vector<Feature>& features;
  double resolution;
  FoundationSurface out;

  using Place = std::vector<int>::iterator;

  // Cuts the set in the middle of its widest extent until all of it is within the resolution.
  void cut(Place begin, Place end) {
    Feature low = features[*begin], high = low;
    for (Place i = begin; i != end; ++i)
      for (int k = 0; k < 6; ++k) {
        low[k] = std::min(low[k], features[*i][k]);
        high[k] = std::max(high[k], features[*i][k]);
      }
    int widest = 0;
    for (int k = 1; k < 6; ++k)
      if (high[k] - low[k] > high[widest] - low[widest]) widest = k;
    if (high[widest] - low[widest] <= resolution) return merge(begin, end);
    const double middle = 0.5 * (low[widest] + high[widest]);
    const Place half = std::partition(begin, end, [&](int i) { return features[i][widest] < middle; });
    if (half == begin || half == end) return merge(begin, end);  // extents of a rounding error
    cut(begin, half);
    cut(half, end);
  }

  void merge(Place begin, Place end) {
    double area = 0;
    Vec3 moment;
    for (Place i = begin; i != end; ++i) {
      area += triangles.areas[*i];
      moment += triangles.areas[*i] * triangles.centres[*i];
    }
    out.centres.push_back(end - begin == 1 ? triangles.centres[*begin] : (1 / area) * moment);
    out.areas.push_back(area);
    out.regions.push_back(triangles.regions[*begin]);
  }
};

}  // namespace

FoundationSurface merged(const FoundationSurface& triangles, const std::vector<Vec3>& normals,
                         double resolution) {
  if (resolution <= 0) return triangles;
  const double weight = resolution / kTurn;
  std::vector<Feature> features;
  for (int i = 0; i < triangles.size(); ++i) {
    const Vec3 x = triangles.centres[i], n = weight * normals[i];
    features.push_back({x.x, x.y, x.z, n.x, n.y, n.z});
  }
  std::vector<int> order(triangles.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return triangles.regions[a] < triangles.regions[b]; });
  Merger merger{triangles, features, resolution, {}};
  for (auto begin = order.begin(); begin != order.end();) {
    const int region = triangles.regions[*begin];
    const auto end = std::find_if(begin, order.end(), [&](int i) { return triangles.regions[i] != region; });
    merger.cut(begin, end);
    begin = end;
  }
  return std::move(merger.out);
}

SphereTree::SphereTree(const std::vector<Vec3>& points) : order_(points.size()) {
  std::iota(order_.begin(), order_.end(), 0);
  add(points, 0, static_cast<int>(points.size()));
}

void SphereTree::add(const std::vector<Vec3>& points, int first, int count) {
  Box box;
  for (int i = first; i < first + count; ++i) box.include(points[order_[i]]);
  Node node{first, count, count <= kLeaf, 0, 0.5 * (box.lo + box.hi), 0};
  for (int i = first; i < first + count; ++i)
    node.radius = std::max(node.radius, norm(points[order_[i]] - node.centre));
  const size_t place = nodes_.size();
  nodes_.push_back(node);
  if (!node.is_leaf) {
    const Vec3 size = box.hi - box.lo;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const int half = count / 2;
    std::nth_element(order_.begin() + first, order_.begin() + first + half, order_.begin() + first + count,
                     [&](int s, int t) { return dot(points[s] - points[t], unit_axis(axis)) < 0; });
    add(points, first, half);
    add(points, first + half, count - half);
  }
  nodes_[place].next = nodes_.size();
}

}  // namespace bt
