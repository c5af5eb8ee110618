#include "contact/contact.h"

#include <algorithm>
#include <limits>

namespace bt {

namespace {

// Depth, in radii, from which a contact is stiffened within the step, by how much, and until when [-].
// Stiffer: what the sliding of a segment over an edge presses in becomes a wild force.
constexpr double kDepth = 5e-4;
constexpr double kStiffening = 10.0;
constexpr double kMostStiffening = 50.0;

// Gap, normal and curvature against the wall of a bore.
void bore_gap(Row& row, Vec3 x, double& curvature, Vec3& around) {
  Vec3 radial = without(x - row.axis_point, row.axis);
  double rho = norm(radial);
  row.gap = row.ring - rho;
  if (rho > 0) row.normal = (-1 / rho) * radial, curvature = 1 / rho;
  around = cross(row.axis, row.normal);
}

}  // namespace

void Row::evaluate(Vec3 relative, bool at_position, bool definite) {
  // By which moving around the axis, and across a mouth's edge, brings the point nearer [1/m].
  double curvature = 0, across_edge = 0;
  Vec3 around;
  if (kind == ContactKind::bore)
    bore_gap(*this, relative, curvature, around);
  else if (kind == ContactKind::mouth)
    mouth_gap(relative, curvature, around, across_edge);
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
  if (pressed && (curvature != 0 || across_edge != 0)) {
    const double least = definite ? 0 : -std::numeric_limits<double>::infinity();
    block += (multiplier * std::max(curvature, least)) * outer(around);
    block += (multiplier * std::max(across_edge, least)) * outer(cross(around, normal));
  }
  if (friction <= 0 || (direct && !held)) return;
  raw = without(stuck + relative - slid - reference, normal);
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
  if (softest == 0 || direct || normal_force <= 0) return false;
  if (-gap <= kDepth * radius) return false;
  take_over(normal_force);
  return true;
}

void Row::take_over(double force) {
  carried = force;
  if (stiffness < kMostStiffening * softest) stiffness *= kStiffening;
}

void Row::limit_friction(double most) {
  if (limit <= 0) sliding = grip * norm(raw) > most;
  limit = most;
}

void Row::settle_friction() {
  if (!direct && friction > 0) limit_friction(friction * multiplier);
}

void Row::settle(Vec3 relative) {
  Vec3 z = without(stuck + relative - reference, normal);
  double pull = grip * norm(z);
  displacement = limit <= 0 ? Vec3{} : pull > limit ? (limit / pull) * z : z;
}

void Row::foresee(Vec3 moved) {
  multiplier = std::max(0.0, force_after(moved));
  if (friction <= 0 || limit <= 0) return;
  Vec3 next = raw + without(moved, normal);
  sliding = grip * norm(next) > limit && !(sliding && dot(next, raw) < 0);
}

}  // namespace bt
