#include "contact/contact.h"

#include <algorithm>
#include <limits>

namespace bt {

namespace {

// A contact with a normal force whose gap differs from zero by more than kGap radii is stiffened within the
// step, by the factor kStiffening, until it is more than kMostStiffening times as stiff as at first [-].
// Larger: the small depths that arise where a segment slides over an edge give excessive forces, and what has
// parted is still pushed. Smaller: gaps take more multiplier updates.
constexpr double kGap = 5e-4;
constexpr double kStiffening = 10.0;
// The stiffness, relative to the first one, up to which it is [-]. Smaller: a body that is heavier by far
// than the tendon goes on into it, and is thrown back. Larger: no difference up to 1e5.
constexpr double kMostStiffening = 1000.0;

// Share of a depth that a stiffer contact leaves, above which nothing yields to it [-]. Larger: where
// segments slide along a surface, a squeeze is not recognised. Smaller: what yields slowly is taken for one.
constexpr double kUnmoved = 0.5;

// Force over that which squeezes the cross-section flat, above which a contact bears by it although what
// presses may give way, if it was as large in the last substep [-]. Where friction locks a body on what it
// squeezes, any force is in equilibrium, so that multipliers grow from step to step at a depth that is too
// small to be seen. Larger: the forces of such a body are larger. Smaller: it enters a soft tendon.
constexpr double kCrushed = 10;

// A contact is softened as long as its gap stays within this share of kGap, to at least this share of its
// first stiffness [-]. Larger and smaller: contacts are softened that have to be stiffened again. Smaller and
// larger: a tendon leaves fewer contacts in an iteration.
constexpr double kSoftGap = 0.4;
constexpr double kSoftest = 1e-3;

}  // namespace

void Contact::round_gap(Vec3 x) {
  const double sign = key.kind == ContactKind::bore ? -1 : 1;  // from within
  const Vec3 radial = without(x - geometry.rim.centre, geometry.rim.axis);
  const double rho = norm(radial);
  geometry.gap = sign * (rho - geometry.rim.radius);
  if (rho > 0) {
    geometry.normal = (sign / rho) * radial;
    curvature.along = -sign / rho;
  }
  if (norm(geometry.rim.axis) > 0) {
    curvature.direction = cross(geometry.rim.axis, geometry.normal);
  } else {
    curvature.direction = any_perpendicular(geometry.normal);
    curvature.across = curvature.along;
  }
}

void Contact::evaluate(Vec3 relative, bool at_position) {
  curvature = {};
  const Vec3 x = relative + geometry.rim_shift + geometry.bulge;
  if (key.kind == ContactKind::mouth)
    mouth_gap(x);
  else if (is_curved())
    round_gap(x);
  else
    geometry.gap = dot(geometry.normal, relative) - geometry.offset;
  geometry.gap -= geometry.depth_allowance;
  if (!normal_force.direct)
    normal_force.value = std::max(0.0, normal_force.lambda - normal_force.stiffness * geometry.gap);
  if (at_position) normal_force.lambda_predicted = normal_force.value;
  // The constraint supplies the normal force of a direct contact. Only its friction is a force here.
  normal_force.pressed =
      !normal_force.direct && (normal_force.value > 0 || normal_force.lambda_predicted > 0);
  force.total = normal_force.direct ? Vec3{} : normal_force.value * geometry.normal;
  friction.force = {};
  if (friction.coefficient <= 0 || (normal_force.direct && !normal_force.held)) return;
  friction.raw =
      without(friction.anchor + relative - geometry.point_shift - friction.relative_start, geometry.normal);
  const double pull = friction.stiffness * norm(friction.raw);
  if (at_position) friction.sliding = pull > friction.limit;
  if (friction.limit <= 0) {
    friction.displacement = {};
    return;
  }
  friction.displacement = pull > friction.limit ? (friction.limit / pull) * friction.raw : friction.raw;
  friction.force = -friction.stiffness * friction.displacement;
  force.total += friction.force;
}

void Contact::linearise(bool definite) {
  force.linear = {};
  force.block = force.turning = {};
  if (normal_force.pressed) {
    force.linear = (normal_force.lambda - normal_force.stiffness * geometry.gap) * geometry.normal;
    force.block = normal_force.stiffness * outer(geometry.normal);
  }
  if (normal_force.pressed && curvature.any()) {
    const double least = definite ? 0 : -std::numeric_limits<double>::infinity();
    const Vec3 beside = cross(curvature.direction, geometry.normal);
    force.turning =
        (normal_force.lambda_predicted * std::max(curvature.along, least)) * outer(curvature.direction);
    force.turning += (normal_force.lambda_predicted * std::max(curvature.across, least)) * outer(beside);
    force.block += force.turning;
  }
  if (friction.coefficient <= 0 || friction.limit <= 0 || (normal_force.direct && !normal_force.held)) return;
  if (!friction.sliding) {
    force.linear += -friction.stiffness * friction.raw;
    force.block += friction.stiffness * across(geometry.normal);
    return;
  }
  force.linear += friction.force;
  const double stretch = norm(friction.raw);
  if (stretch == 0) return;
  const Vec3 along = (1 / stretch) * friction.raw;
  force.block += (std::min(friction.limit, friction.stiffness * stretch) / stretch) *
                 (across(geometry.normal) + (-1.0) * outer(along));
}

void Contact::bear(double load, double sticking_ratio) {
  const double transverse = load / geometry.radius;
  friction.stiffness += sticking_ratio * transverse;
  normal_force.stiffness = std::max(normal_force.stiffness, transverse / kGap);
  normal_force.first_stiffness = normal_force.stiffness;
}

bool Contact::is_closed() const { return std::fabs(geometry.gap) <= kGap * geometry.radius; }

bool Contact::may_stiffen() const {
  if (normal_force.first_stiffness == 0 || normal_force.direct || normal_force.value <= 0) return false;
  if (normal_force.squeezed == Squeezed::no) return !is_closed() || is_crushed();
  return normal_force.squeezed == Squeezed::before;
}

bool Contact::stiffen(bool by_what_yields, bool finds_out) {
  if (!may_stiffen()) return false;
  if (normal_force.squeezed == Squeezed::before) {
    if (!finds_out && is_unmoved()) return false;
    normal_force.squeezed = Squeezed::no;
    normal_force.stiffness = normal_force.first_stiffness;
    geometry.gap -= geometry.depth_to_leave;
    geometry.depth_allowance = geometry.depth_to_leave;
    normal_force.first_gap = geometry.gap;
    take_over(normal_force.value);
    return true;
  }
  if (is_crushed() ? !finds_out : !by_what_yields && is_squeezed()) {
    bear_by_section(Squeezed::now);
    return true;
  }
  if (is_closed()) return false;
  take_over(normal_force.value);
  return true;
}

bool Contact::is_unmoved() const { return geometry.gap < kUnmoved * normal_force.first_gap; }

// Whether nothing yields to it, although it is stiffer than the cross-section.
bool Contact::is_squeezed() {
  if (normal_force.first_gap == 0) {
    normal_force.first_gap = geometry.gap;
    return false;
  }
  return geometry.gap < 0 && is_unmoved() && normal_force.stiffness > normal_force.section;
}

bool Contact::is_crushed() const {
  const double lasting = std::min(normal_force.value, normal_force.lambda_previous);
  return lasting > kCrushed * 2 * geometry.radius * normal_force.section;
}

// A multiplier would grow without limit. The cross-section bears all of its depth. Once it no longer does,
// the contact corrects no more of the depth in this substep than others do.
void Contact::bear_by_section(Squeezed since) {
  normal_force.squeezed = since;
  normal_force.lambda = 0;
  normal_force.stiffness = normal_force.section;
  geometry.depth_allowance = 0;
}

bool Contact::soften() {
  if (normal_force.first_stiffness == 0 || normal_force.direct) return false;
  const double most = kSoftGap * kGap * geometry.radius;
  if (std::fabs(geometry.gap) > most) return false;
  const double enough = std::max(kSoftest * normal_force.first_stiffness, normal_force.value / most);
  if (!(enough < 0.5 * normal_force.stiffness)) return false;
  normal_force.stiffness = enough;
  return true;
}

void Contact::take_over(double force) {
  normal_force.lambda = force;
  if (normal_force.stiffness <= kMostStiffening * normal_force.first_stiffness)
    normal_force.stiffness *= kStiffening;
}

void Contact::settle(Vec3 relative) {
  Vec3 z = without(friction.anchor + relative - friction.relative_start, geometry.normal);
  double pull = friction.stiffness * norm(z);
  friction.displacement = friction.limit <= 0     ? Vec3{}
                          : pull > friction.limit ? (friction.limit / pull) * z
                                                  : z;
}

void Contact::predict(Vec3 moved, bool keeps_limit) {
  normal_force.lambda_predicted = std::max(0.0, force_after(moved));
  if (friction.coefficient <= 0) return;
  if (friction.limit > 0) {
    const Vec3 next = friction.raw + without(moved, geometry.normal);
    friction.sliding = friction.stiffness * norm(next) > friction.limit &&
                       !(friction.sliding && dot(next, friction.raw) < 0);
  }
  if (!acts() || keeps_limit) return;
  const bool had_limit = friction.limit > 0;
  limit_friction(normal_force.direct ? normal_force.value : normal_force.lambda_predicted);
  if (!had_limit) friction.sliding = friction.stiffness * norm(friction.raw) > friction.limit;
}

}  // namespace bt
