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
  if (friction <= 0) return;
  if (follow_limit) limit = friction * normal_force;
  displacement = without(stuck + relative - reference, normal);
  if (limit <= 0) {
    displacement = {};
    return;
  }
  double stretch = norm(displacement), pull = stiffness * stretch;
  if (pull <= limit) {
    tangent_force = -stiffness * displacement;
    block += stiffness * across(normal);
  } else {
    Vec3 along = (1 / stretch) * displacement;
    tangent_force = -limit * along;
    block += (limit / stretch) * (across(normal) + (-1.0) * outer(along));
    displacement = (limit / stiffness) * along;
  }
  total_force += tangent_force;
}

}  // namespace bt
