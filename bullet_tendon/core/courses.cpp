#include "courses.h"

#include "search_constants.h"

namespace bt {

namespace {

// Of to - from, in leaves of kLeafSegments, whose last particles are the next one's first.
BT_VECTOR void ranges_of(const double* from, const double* to, int n, double* least, double* most) {
  static_assert(kLeafSegments == 4, "a leaf has five particles");
  const int full = (n - 1) / 4;
#pragma GCC ivdep
  for (int l = 0; l < full; ++l) {
    const double *p = from + 4 * l, *q = to + 4 * l;
    const double a = q[0] - p[0], b = q[1] - p[1], c = q[2] - p[2], d = q[3] - p[3], e = q[4] - p[4];
    const double low = a < b ? a : b, mid = c < d ? c : d, high = a > b ? a : b, top = c > d ? c : d;
    const double under = low < mid ? low : mid, over = high > top ? high : top;
    least[l] = under < e ? under : e, most[l] = over > e ? over : e;
  }
  if (4 * full == n - 1) return;
  least[full] = 1e300, most[full] = -1e300;
  for (int i = 4 * full; i < n; ++i) {
    least[full] = std::min(least[full], to[i] - from[i]);
    most[full] = std::max(most[full], to[i] - from[i]);
  }
}

}  // namespace

void Courses::fit_leaves(const Chain& c) {
  const int leaves = leaves_of(c.n() - 1);
  if (least_.size() != leaves) least_.resize(6, leaves), most_.resize(6, leaves);
  for (int k = 0; k < 3; ++k) {
    ranges_of(last_[k], c.x[k], c.n(), least_[k], most_[k]);
    ranges_of(c.x[k], c.foreseen[k], c.n(), least_[3 + k], most_[3 + k]);
  }
}

void Courses::look(const Chain& c, const Strands& strands) {
  if (last_.size() != c.x.size()) last_ = c.x, courses_.clear();
  const int count = strands.size();
  courses_.resize(count), ranges_.resize(count);
  fit_leaves(c);
  for (int i = count - 1; i >= 0; --i) {  // children come after what they are of
    const Strand& s = strands[i];
    Ranges& r = ranges_[i];
    if (s.second < 0) {
      const int l = s.first / kLeafSegments;
      auto at = [l](const Planes& p, int k) { return Vec3{p[k][l], p[k + 1][l], p[k + 2][l]}; };
      r = {at(least_, 0), at(most_, 0), at(least_, 3), at(most_, 3)};
    } else {
      const Ranges &p = ranges_[i + 1], &q = ranges_[s.second];
      r = {lowest(p.low, q.low), highest(p.high, q.high), lowest(p.near, q.near), highest(p.far, q.far)};
    }
    const Travel now = travel_between(r.low, r.high);
    courses_[i].gone.by += now.by, courses_[i].gone.off += now.off;
    courses_[i].way = travel_between(r.near, r.far);
  }
  last_ = c.x;
}

}  // namespace bt
