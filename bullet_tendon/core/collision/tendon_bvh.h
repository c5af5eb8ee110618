// A tendon as the search for tendons that could touch sees it: a bounding volume hierarchy of its segments,
// how far it moves, and which of its segments are neighbours.
#pragma once
#include <algorithm>
#include <vector>

#include "geometry/aabb.h"
#include "geometry/motion_bound.h"
#include "tendon/tendon.h"

namespace bt {

// The box around where a segment is and, as foreseen, will be at the end of the step, relative to its
// tendon's mean motion, grown by skin and slack.
Box swept_box(const Tendon& c, int segment, Vec3 mean_motion, double skin);

// The hierarchy is an implicit binary tree: node 1 is the root, nodes 2 i and 2 i + 1 are the children of
// node i, and the second half of all nodes, a power of two, are the segments. Those beyond the tendon's end
// are empty boxes, which are near nothing.
class TendonBvh {
 public:
  // Follows the tendon, always the same, to where it is and is foreseen to be. threshold: distance of the
  // surfaces at which contacts begin [m].
  void follow(const Tendon& c, double threshold);
  const Tendon& tendon() const { return *tendon_; }

  // Motion since the first call of follow(): the sum over all calls; and within this step, as foreseen.
  const MotionBound& moved() const { return moved_; }
  const MotionBound& ahead() const { return ahead_; }
  // How far its centreline acts; and that, where it may end off what is foreseen [m].
  double skin() const { return skin_; }
  double reach() const { return skin_ + tendon_->most_slack; }

  // Where segments are, and what they are foreseen to move by within the step.
  struct Node {
    Box at;
    Box ahead;
  };
  void refit();
  const Node& operator[](int node) const { return nodes_[node]; }
  bool is_leaf(int node) const { return node >= leaves_; }
  int first(int node) const { return node * width(node) - leaves_; }
  // No segment lies below it: there are as many leaves as the next power of two.
  bool is_empty(int node) const { return first(node) >= tendon_->n() - 1; }
  int last(int node) const { return std::min(first(node) + width(node), tendon_->n() - 1) - 1; }
  // Segments below a node, those beyond the end included.
  int width(int node) const { return leaves_ >> (31 - __builtin_clz(static_cast<unsigned>(node))); }

  // Rest length between two segments, k before m [m].
  double arc_between(int k, int m) const { return arc_[m] - arc_[k + 1]; }
  // Segments that a spring joins, or so near along the tendon that no bend brings them together.
  bool joins(int k, int m) const { return m - k <= 1 || arc_between(k, m) < joined_arc_; }
  int rest_set() const { return rest_set_; }  // changes with the rest lengths

  // Of its particles within the step, as foreseen; and the most that one moves besides [m].
  Vec3 mean_motion();
  double most_off_mean();

 private:
  void begin(const Tendon& c);
  const Tendon* tendon_ = nullptr;
  Field last_;
  MotionBound moved_, ahead_;
  double skin_ = 0;
  std::vector<Node> nodes_;
  int leaves_ = 0;
  bool fitted_ = false;    // in this call of follow()
  bool averaged_ = false;  // the same
  Vec3 mean_motion_;
  std::vector<double> arc_;  // rest length up to each particle [m]
  double joined_arc_ = 0;    // [m]
  int rest_set_ = -1;
};

}  // namespace bt
