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
void bore_gap(Contact& contact, Vec3 x, double& curvature, Vec3& around) {
  Vec3 radial = without(x - contact.axis_point, contact.axis);
  double rho = norm(radial);
  contact.gap = contact.feature_radius - rho;
  if (rho > 0) contact.normal = (-1 / rho) * radial, curvature = 1 / rho;
  around = cross(contact.axis, contact.normal);
}

}  // namespace

void Contact::evaluate(Vec3 relative, bool at_position, bool definite) {
  // By which moving around the axis, and across a mouth's edge, brings the point nearer [1/m].
  double curvature = 0, across_edge = 0;
  Vec3 around;
  if (kind == ContactKind::bore)
    bore_gap(*this, relative, curvature, around);
  else if (kind == ContactKind::mouth)
    mouth_gap(relative, curvature, around, across_edge);
  else
    gap = dot(normal, relative) - offset;
  gap -= depth_allowance;
  if (!direct) normal_force = std::max(0.0, lambda - stiffness * gap);
  if (at_position) lambda_predicted = normal_force;
  // A direct contact's normal force is what the constraint supplies: only its friction is a force here.
  pressed = !direct && (normal_force > 0 || lambda_predicted > 0);
  total_force = direct ? Vec3{} : normal_force * normal;
  linear_force = pressed ? (lambda - stiffness * gap) * normal : Vec3{};
  tangent_force = {};
  block = {};
  if (pressed) block = stiffness * outer(normal);
  if (pressed && (curvature != 0 || across_edge != 0)) {
    const double least = definite ? 0 : -std::numeric_limits<double>::infinity();
    block += (lambda_predicted * std::max(curvature, least)) * outer(around);
    block += (lambda_predicted * std::max(across_edge, least)) * outer(cross(around, normal));
  }
  if (friction <= 0 || (direct && !held)) return;
  raw = without(tangent_anchor + relative - point_shift - relative_start, normal);
  if (at_position) sliding = tangent_stiffness * norm(raw) > limit;
  if (limit <= 0) {
    displacement = {};
    return;
  }
  double stretch = norm(raw), pull = tangent_stiffness * stretch;
  bool over = pull > limit;
  displacement = over ? (limit / pull) * raw : raw;
  tangent_force = -tangent_stiffness * displacement;
  linear_force += sliding ? tangent_force : -tangent_stiffness * raw;
  total_force += tangent_force;
  if (!sliding) {
    block += tangent_stiffness * across(normal);
  } else if (stretch > 0) {
    Vec3 along = (1 / stretch) * raw;
    block += (std::min(limit, pull) / stretch) * (across(normal) + (-1.0) * outer(along));
  }
}

bool Contact::stiffen() {
  if (softest == 0 || direct || normal_force <= 0) return false;
  if (-gap <= kDepth * radius) return false;
  take_over(normal_force);
  return true;
}

void Contact::take_over(double force) {
  lambda = force;
  if (stiffness < kMostStiffening * softest) stiffness *= kStiffening;
}

void Contact::settle(Vec3 relative) {
  Vec3 z = without(tangent_anchor + relative - relative_start, normal);
  double pull = tangent_stiffness * norm(z);
  displacement = limit <= 0 ? Vec3{} : pull > limit ? (limit / pull) * z : z;
}

void Contact::predict(Vec3 moved) {
  lambda_predicted = std::max(0.0, force_after(moved));
  if (friction <= 0) return;
  if (limit > 0) {
    const Vec3 next = raw + without(moved, normal);
    sliding = tangent_stiffness * norm(next) > limit && !(sliding && dot(next, raw) < 0);
  }
  if (!acts()) return;
  const double most = friction * (direct ? normal_force : lambda_predicted);
  if (limit <= 0) sliding = tangent_stiffness * norm(raw) > most;
  limit = most;
}

}  // namespace bt
