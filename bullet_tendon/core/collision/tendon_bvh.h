// The data of a tendon for the broad phase: a bounding volume hierarchy of its segments, bounds of its
// motion, and which of its segments are neighbours.
#pragma once
#include <algorithm>
#include <vector>

#include "geometry/bounds.h"
#include "tendon/tendon.h"

namespace bt {

// Box around the present and the predicted position of a segment, less its tendon's mean motion, grown by
// skin and slack [m].
Box swept_box(const Tendon& c, int segment, Vec3 mean_motion, double skin);

// The hierarchy is an implicit binary tree: node 1 is the root, nodes 2 i and 2 i + 1 are the children of
// node i, and the second half of the nodes (a power of two) are the leaves, one per segment. Leaves beyond
// the tendon's end are empty boxes.
class TendonBvh {
 public:
  // Updates the motion bounds to the tendon's present and predicted positions. Every call needs the same
  // tendon. threshold: distance of the surfaces at which contacts begin [m].
  void follow(const Tendon& c, double threshold);
  const Tendon& tendon() const { return *tendon_; }

  // Motion since the first call of follow(), summed over all calls; and the predicted motion of this step.
  const MotionBound& moved() const { return moved_; }
  const MotionBound& ahead() const { return ahead_; }
  // Distance of contact from the centreline; and the same plus the greatest deviation from the prediction
  // [m].
  double skin() const { return skin_; }
  double reach() const { return skin_ + tendon_->most_slack; }

  // Boxes around the positions of segments, and around their predicted displacements within the step [m].
  struct Node {
    Box at;
    Box ahead;
  };
  void refit();
  const Node& operator[](int node) const { return nodes_[node]; }
  bool is_leaf(int node) const { return node >= leaves_; }
  int first(int node) const { return node * width(node) - leaves_; }
  // Whether no segment is below the node.
  bool is_empty(int node) const { return first(node) >= tendon_->n() - 1; }
  int last(int node) const { return std::min(first(node) + width(node), tendon_->n() - 1) - 1; }
  // Number of leaves below a node, with those beyond the tendon's end.
  int width(int node) const { return leaves_ >> (31 - __builtin_clz(static_cast<unsigned>(node))); }

  // Rest length between segments k < m [m].
  double arc_between(int k, int m) const { return arc_[m] - arc_[k + 1]; }
  // Whether segments share a particle, or are so near along the tendon that no bend brings them into contact.
  bool joins(int k, int m) const { return m - k <= 1 || arc_between(k, m) < joined_arc_; }
  int rest_set() const { return rest_set_; }  // number of the set of rest lengths; changes with them

  // Predicted mean motion of the particles within the step [m].
  Vec3 mean_motion() const { return mean_motion_; }

 private:
  void begin(const Tendon& c);
  const Tendon* tendon_ = nullptr;
  Field last_;
  MotionBound moved_, ahead_;
  double skin_ = 0;
  std::vector<Node> nodes_;
  int leaves_ = 0;
  bool fitted_ = false;  // since the last call of follow()
  Vec3 mean_motion_;
  std::vector<double> arc_;  // rest length up to each particle [m]
  double joined_arc_ = 0;    // [m]
  int rest_set_ = -1;
};

}  // namespace bt
