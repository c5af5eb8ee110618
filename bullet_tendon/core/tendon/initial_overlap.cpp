// Stretches of a tendon that overlap at the start.
//
// Where centrelines start much nearer to each other than two radii, the correct side of the contact is not
// known. If contacts pushed them apart along the direction that is between them by chance, a collapsed tendon
// would form a knot. Such pairs have no contacts until they have separated. Neither do the neighbouring
// pairs to which the crossing slides.
#include <algorithm>
#include <cstdint>
#include <vector>

#include "geometry/segment_distance.h"
#include "tendon/tendon.h"

namespace bt {

namespace {

// Two segments of one tendon overlap at the start if their distance is below this share of the sum of the
// radii [-]. Larger: stretches that touch at the start pass through each other. Smaller: a crumpled start
// forms knots.
constexpr double kOverlaid = 0.5;
// The same for neighbours of such pairs [-]. No contact is so deep.
constexpr double kStillOverlaid = 0.9;

uint64_t pair_of(int k, int m) { return static_cast<uint64_t>(k) << 32 | static_cast<uint32_t>(m); }

double distance_of(const Field& x, int k, int m) {
  return segment_distance(x.at(k), x.at(k + 1), x.at(m), x.at(m + 1));
}

}  // namespace

void Tendon::find_overlaid() {
  overlaid.clear();
  const double near = kOverlaid * 2 * radius;
  double longest = 0;
  for (int k = 0; k + 1 < n_; ++k) longest = std::max(longest, norm(x.at(k + 1) - x.at(k)));
  for (int k = 0; k + 1 < n_; ++k) {
    const Vec3 middle = 0.5 * (x.at(k) + x.at(k + 1));
    double arc = 0;
    for (int m = k + 2; m + 1 < n_; ++m) {
      arc += rest[m - 1];
      if (arc < self_contact_arc(radius)) continue;
      const double far = norm(0.5 * (x.at(m) + x.at(m + 1)) - middle) - longest - near;
      if (far < 0 && distance_of(x, k, m) < near) overlaid.push_back(pair_of(k, m));
      // The next far/longest segments cannot be near. Skip them.
      for (int skip = longest > 0 ? static_cast<int>(far / longest) : 0; skip > 0 && m + 2 < n_; --skip)
        arc += rest[++m - 1];
    }
  }
}

bool Tendon::is_overlaid(int k, int m) const {
  if (overlaid.empty()) return false;
  for (int i = k - 1; i <= k + 1; ++i)
    for (int j = m - 1; j <= m + 1; ++j)
      if (i >= 0 && std::binary_search(overlaid.begin(), overlaid.end(), pair_of(i, j))) return true;
  return false;
}

void Tendon::let_overlaid_part() {
  if (overlaid.empty()) return;
  std::vector<uint64_t> still;
  for (const uint64_t pair : overlaid) {
    const int k = static_cast<int>(pair >> 32), m = static_cast<int>(pair & 0xffffffffu);
    if (distance_of(x, k, m) < 2 * radius) still.push_back(pair);
    // The neighbouring pairs to which the crossing slides.
    for (int i = std::max(k - 1, 0); i <= k + 1; ++i)
      for (int j = std::max(m - 1, i + 2); j <= std::min(m + 1, n_ - 2); ++j)
        if (distance_of(x, i, j) < kStillOverlaid * 2 * radius) still.push_back(pair_of(i, j));
  }
  std::sort(still.begin(), still.end());
  still.erase(std::unique(still.begin(), still.end()), still.end());
  overlaid.swap(still);
}

}  // namespace bt
