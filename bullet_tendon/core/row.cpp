#include "row.h"

#include "constants.h"

namespace bt {

namespace {

// Gap, normal and curvature against the wall of a bore.
void bore_gap(Row& row, Vec3 x, double& curvature, Vec3& around) {
  Vec3 radial = without(x - row.axis_point, row.axis);
  double rho = norm(radial);
  row.gap = row.ring - rho;
  if (rho > 0) row.normal = (-1 / rho) * radial, curvature = 1 / rho;
  around = cross(row.axis, row.normal);
}

// The same against the circle of a mouth: d = sqrt((R - rho)^2 + z^2). Moving around the axis
// by s brings the point nearer to the circle by (R - rho)/(d rho) s^2/2.
void mouth_gap(Row& row, Vec3 x, double& curvature, Vec3& around) {
  Vec3 from = x - row.axis_point, radial = without(from, row.axis);
  double rho = norm(radial), z = dot(from, row.axis), inward = row.ring - rho;
  Vec3 out = rho > 0 ? (1 / rho) * radial : any_perpendicular(row.axis);
  double d = std::sqrt(inward * inward + z * z);
  // A segment of the bore that has got beyond the circle is in the bone: back through the edge.
  double sign = row.through && inward < 0 ? -1 : 1;
  row.gap = sign * d - row.offset;
  if (d > 0) row.normal = (sign / d) * (z * row.axis - inward * out);
  if (d > 0 && rho > 0 && inward > 0) curvature = inward / (d * rho);
  around = cross(row.axis, out);
}

}  // namespace

void Row::evaluate(Vec3 relative, bool at_position) {
  double curvature = 0;  // by which moving around the axis brings the point nearer [1/m]
  Vec3 around;
  if (kind == ContactKind::bore)
    bore_gap(*this, relative, curvature, around);
  else if (kind == ContactKind::mouth)
    mouth_gap(*this, relative, curvature, around);
  else
    gap = dot(normal, relative) - offset;
  gap -= allowed;
  if (!direct) normal_force = std::max(0.0, carried - stiffness * gap);
  if (at_position) multiplier = normal_force;
  // A direct row's normal force is what the constraint supplies: only its friction is a force here.
  pressed = !direct && (normal_force > 0 || multiplier > 0);
  total_force = direct ? Vec3{} : normal_force * normal;
  linear_force = pressed ? (carried - stiffness * gap) * normal : Vec3{};
  tangent_force = {};
  block = {};
  if (pressed) block = stiffness * outer(normal);
  if (curvature > 0 && pressed) block += (multiplier * curvature) * outer(around);
  if (friction <= 0 || (direct && !held)) return;
  raw = without(stuck + relative - reference, normal);
  if (at_position) sliding = grip * norm(raw) > limit;
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

bool Row::stiffen() {
  if (!stiffens || direct || normal_force <= 0 || -(gap + yield * normal_force) <= kDepth * radius)
    return false;
  const double unsoftened = stiffness / (1 - std::min(stiffness * yield, 1 - 1e-6));
  stiffness = kStiffening * unsoftened / (1 + kStiffening * unsoftened * yield);
  if (yield == 0) carried = normal_force;
  return true;
}

void Row::settle(Vec3 relative) {
  Vec3 z = without(stuck + relative - reference, normal);
  double pull = grip * norm(z);
  displacement = limit <= 0 ? Vec3{} : pull > limit ? (limit / pull) * z : z;
}

void Row::foresee(Vec3 moved) {
  multiplier = std::max(0.0, carried - stiffness * (gap + dot(normal, moved)));
  if (friction <= 0 || limit <= 0) return;
  Vec3 next = raw + without(moved, normal);
  sliding = grip * norm(next) > limit && !(sliding && dot(next, raw) < 0);
}

}  // namespace bt
