#include "cartilage/foundation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace bt {

namespace {

// Share of the thickness up to which the logarithm is followed [-]. More: a slope that Newton's method does
// not follow. Less: a layer that can be pressed flat by less than what it bears.
constexpr double kMostStrain = 0.95;
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

FoundationLaw::Value FoundationLaw::at(double d) const {
  const double k = stiffness, h = thickness;
  if (!logarithmic) return {k * d, k, 0.5 * k * d * d, k * d * d * d / 3};
  const double most = kMostStrain * h, e = std::max(0.0, d - most);
  const double v = 1 - std::min(d, most) / h, log = std::log(v);
  const double pressure = -k * h * log, slope = k / v;
  const double energy = k * h * h * (1 - v + v * log);
  const double moment = k * h * h * h * (0.75 - v + 0.25 * v * v + (v - 0.5 * v * v) * log);
  return {pressure + slope * e, slope, energy + e * (pressure + 0.5 * slope * e),
          moment + e * (most * pressure + e * (0.5 * (most * slope + pressure) + slope * e / 3))};
}

}  // namespace bt
