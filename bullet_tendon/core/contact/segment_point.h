#pragma once
#include "math/soa_field.h"

namespace bt {

// A point of segment `first` of a tendon: w0 x_first + w1 x_first+1, w0 + w1 = 1.
struct SegmentPoint {
  int tendon = -1;
  int first = 0;
  double w0 = 1, w1 = 0;
  Vec3 of(const Field& f) const {
    return w1 == 0   ? w0 * f.at(first)
           : w0 == 0 ? w1 * f.at(first + 1)
                     : w0 * f.at(first) + w1 * f.at(first + 1);
  }
};

// Particle i of a tendon of so many particles, as a point of a segment.
inline SegmentPoint particle_point(int tendon, int i, int particles) {
  return i < particles - 1 ? SegmentPoint{tendon, i, 1, 0} : SegmentPoint{tendon, i - 1, 0, 1};
}

// Subtracts the force `pull` at the point s from its two particles, in shares w0 and w1.
inline void pull_back(Field& f, const SegmentPoint& s, Vec3 pull) {
  f.add(s.first, -s.w0 * pull);
  f.add(s.first + 1, -s.w1 * pull);
}

}  // namespace bt
