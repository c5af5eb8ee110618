#include "row.h"

namespace bt {

void Row::evaluate(Vec3 relative, bool follow_limit) {
  double curvature = 0;  // of the bore, across its axis [1/m]
  if (kind == ContactKind::bore) {
    Vec3 radial = without(relative - axis_point, axis);
    double distance = norm(radial);
    gap = clearance - distance;
    if (distance > 0) normal = (-1 / distance) * radial, curvature = 1 / distance;
  } else {
    gap = dot(normal, relative) - offset;
  }
  normal_force = std::max(0.0, carried - stiffness * gap);
  total_force = normal_force * normal;
  tangent_force = {};
  block = {};
  if (normal_force > 0) block = stiffness * outer(normal);
  if (kind == ContactKind::bore && normal_force > 0)
    block += (normal_force * curvature) * (across(normal) + (-1.0) * outer(axis));
  linear_force = total_force;
  if (friction <= 0) return;
  if (follow_limit) limit = friction * normal_force;
  raw = without(stuck + relative - reference, normal);
  if (limit <= 0) {
    displacement = {};
    return;
  }
  double stretch = norm(raw), pull = grip * stretch;
  bool over = pull > limit;
  displacement = over ? (limit / pull) * raw : raw;
  tangent_force = -grip * displacement;
  linear_force += sliding ? tangent_force : -grip * raw;
  total_force += tangent_force;
  if (!sliding) {
    block += grip * across(normal);
  } else if (stretch > 0) {
    Vec3 along = (1 / stretch) * raw;
    block += (std::min(limit, pull) / stretch) * (across(normal) + (-1.0) * outer(along));
  }
}

void Row::foresee(Vec3 moved) {
  if (friction <= 0 || limit <= 0) return;
  Vec3 next = raw + without(moved, normal);
  sliding = grip * norm(next) > limit && !(sliding && dot(next, raw) < 0);
}

void Row::take_position() {
  sliding = grip * norm(raw) > limit;
  linear_force = total_force;
}

}  // namespace bt
