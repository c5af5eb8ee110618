#include "travel.h"

namespace bt {

namespace {

// Eight numbers side by side, wherever they begin.
constexpr int kLanes = 8;
typedef double Lanes
    __attribute__((vector_size(kLanes * sizeof(double)), aligned(sizeof(double)), may_alias));

struct Range {
  Lanes least = Lanes{} + 1e300, greatest = Lanes{} - 1e300;
};

// Ranges of x - from and of to - x, of all three components. The last eight may be looked at twice.
BT_VECTOR void ranges_of(const Field& from, const Field& x, const Field& to, Range (&gone)[3],
                         Range (&way)[3]) {
  const int n = x.size();
  for (int c = 0; c < 3; ++c) {
    const double *p = from[c], *q = x[c], *r = to[c];
    Lanes low = gone[c].least, high = gone[c].greatest, near = low, far = high;
    for (int k = 0; k < n && n >= kLanes; k += kLanes) {
      const int i = std::min(k, n - kLanes);
      const Lanes here = *reinterpret_cast<const Lanes*>(q + i);
      const Lanes before = here - *reinterpret_cast<const Lanes*>(p + i);
      const Lanes ahead = *reinterpret_cast<const Lanes*>(r + i) - here;
      low = before < low ? before : low, high = before > high ? before : high;
      near = ahead < near ? ahead : near, far = ahead > far ? ahead : far;
    }
    for (int i = 0; i < n && n < kLanes; ++i) {
      low[i] = q[i] - p[i], high[i] = low[i];
      near[i] = r[i] - q[i], far[i] = near[i];
    }
    gone[c].least = low, gone[c].greatest = high, way[c].least = near, way[c].greatest = far;
  }
}

Travel travel_in(const Range (&range)[3]) {
  double lo[3], hi[3];
  for (int c = 0; c < 3; ++c) {
    double p[kLanes], q[kLanes];
    for (int l = 0; l < kLanes; ++l) p[l] = range[c].least[l], q[l] = range[c].greatest[l];
    for (int half = kLanes / 2; half > 0; half /= 2)
      for (int l = 0; l < half; ++l) p[l] = std::min(p[l], p[l + half]), q[l] = std::max(q[l], q[l + half]);
    lo[c] = p[0], hi[c] = q[0];
  }
  return travel_between({lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]});
}

}  // namespace

void Traveller::look(const Field& x, const Field& foreseen, double slack, double skin) {
  if (reference_.size() != x.size()) reference_ = x, before_ = {};
  Range gone[3], way[3];
  ranges_of(reference_, x, foreseen, gone, way);
  now_ = travel_in(gone), way_ = travel_in(way);
  skin_ = skin, reach_ = skin + slack;
}

void Traveller::settle(const Field& x) {
  before_.by += now_.by, before_.off += now_.off;
  reference_ = x, now_ = {};
}

}  // namespace bt
