#include "collision/tendon_bvh.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "tendon/tendon.h"

namespace bt {

Box swept_box(const Tendon& c, int segment, Vec3 mean_motion, double skin) {
  Box box;
  for (int i : {segment, segment + 1}) {
    box.include(c.x.at(i));
    box.include(c.predicted.at(i) - mean_motion);
  }
  box.grow(skin + std::max(c.slack[segment], c.slack[segment + 1]));
  return box;
}

void TendonBvh::begin(const Tendon& c) {
  last_ = c.x;
  leaves_ = 1;
  while (leaves_ < c.n() - 1) leaves_ *= 2;
  nodes_.assign(2 * leaves_, Node{});
}

void TendonBvh::follow(const Tendon& c, double threshold) {
  tendon_ = &c;
  fitted_ = false;
  skin_ = c.radius + 0.5 * threshold;
  if (nodes_.empty()) begin(c);
  const MotionBound since = motion_between(last_, c.x);
  moved_.by += since.by;
  moved_.off += since.off + std::numeric_limits<double>::epsilon() * max_abs(moved_.by);  // rounded sums
  ahead_ = motion_between(c.x, c.predicted);
  mean_motion_ = {};
  for (int i = 0; i < c.n(); ++i) mean_motion_ += (1.0 / c.n()) * (c.predicted.at(i) - c.x.at(i));
  last_ = c.x;
  if (std::exchange(rest_set_, c.rest_set) == c.rest_set) return;
  joined_arc_ = self_contact_arc(c.radius);
  arc_.assign(c.n(), 0.0);
  for (int k = 0; k + 1 < c.n(); ++k) arc_[k + 1] = arc_[k] + c.rest[k];
}

void TendonBvh::refit() {
  if (std::exchange(fitted_, true)) return;
  const Tendon& c = *tendon_;
  for (int k = 0; k + 1 < c.n(); ++k) {
    const Vec3 x = c.x.at(k), y = c.x.at(k + 1);
    const Vec3 x_ahead = c.predicted.at(k) - x, y_ahead = c.predicted.at(k + 1) - y;
    nodes_[leaves_ + k] = {{lowest(x, y), highest(x, y)},
                           {lowest(x_ahead, y_ahead), highest(x_ahead, y_ahead)}};
  }
  for (int i = leaves_ - 1; i > 0; --i) {
    nodes_[i] = nodes_[2 * i];
    nodes_[i].at.include(nodes_[2 * i + 1].at);
    nodes_[i].ahead.include(nodes_[2 * i + 1].ahead);
  }
}

}  // namespace bt
