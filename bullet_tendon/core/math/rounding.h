// What is taken for rounding, and a search that ends there.
#pragma once
#include <cmath>

namespace bt {

// Share of a quantity below which a difference of it is taken for rounding [-]: of lengths, distances, rates
// and mobilities. Rounding errors of coordinates that are a thousand times as large are smaller. Larger:
// small but real differences are lost. Smaller: rounding decides.
constexpr double kRoundingShare = 1e-9;
// Rounding of a few operations, as a share of the numbers they are done with [-]: of a closed form for a
// place, a distance or the cosine between a segment and the way to it, of the parameter at which a search
// along a segment ends, and of the pivot of a degree of freedom, as a share of its mass or response. Larger:
// what is slanted, or a little way off, is taken for flat, or touching, and light bodies that carry heavy
// links do not respond. Smaller: rounding decides.
constexpr double kFormRounding = 1e-14;

// Where `value` is least between left and right, if it has one minimum there: golden section (Kiefer 1953). A
// minimum is flat, so that the least value is accurate to rounding although the place is not.
//
// The inner points u < v divide the interval in the golden ratio from both ends. What remains of the interval
// after a step contains one of them, which divides it in the same ratio. A step therefore needs one value.
template <class Value>
double golden_section(double left, double right, Value value) {
  const double golden = 0.5 * (std::sqrt(5.0) - 1);
  double u = right - golden * (right - left), v = left + golden * (right - left);
  double at_u = value(u), at_v = value(v);
  while (right - left > kRoundingShare) {
    if (at_u <= at_v) {
      right = v;
      v = u;
      at_v = at_u;
      u = right - golden * (right - left);
      at_u = value(u);
    } else {
      left = u;
      u = v;
      at_u = at_v;
      v = left + golden * (right - left);
      at_v = value(v);
    }
  }
  return 0.5 * (left + right);
}

}  // namespace bt
