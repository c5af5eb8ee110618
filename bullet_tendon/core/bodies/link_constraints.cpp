#include "bodies/link_constraints.h"

namespace bt {

namespace {

// The frame of an end in the world, and the Jacobian (6 n) of its origin; none: nothing moves it.
struct PlacedEnd {
  Pose frame;
  dense::Numbers jacobian;
};

PlacedEnd placed(const ConstraintEnd& end, int n, const std::function<ConstrainedLink(int)>& at) {
  if (end.link < 0) return {end.frame, dense::Numbers(6 * n)};
  ConstrainedLink link = at(end.link);
  const Pose frame{link.inertial.rotation * end.frame.rotation, to_world(link.inertial, end.frame.origin)};
  const Vec3 arm = frame.origin - link.inertial.origin;
  for (int k = 0; k < n; ++k) {
    auto row = [&](int i) -> double& { return link.jacobian[i * n + k]; };
    const Vec3 moved = cross(Vec3{row(3), row(4), row(5)}, arm);
    row(0) += moved.x;
    row(1) += moved.y;
    row(2) += moved.z;
  }
  return {frame, link.jacobian};
}

void add_gear(const LinkConstraint& c, int n, std::vector<ConstraintRow>& rows) {
  ConstraintRow row{dense::Numbers(n), 0, 0, c.most};
  row.direction[c.a.coordinate] += 1;
  row.direction[c.b.coordinate] += c.ratio;
  rows.push_back(row);
}

}  // namespace

void add_constraint_rows(const LinkConstraint& c, int n, const std::function<ConstrainedLink(int)>& at,
                         std::vector<ConstraintRow>& rows) {
  if (c.kind == ConstraintKind::gear) return add_gear(c, n, rows);
  const PlacedEnd a = placed(c.a, n, at), b = placed(c.b, n, at);
  const Vec3 apart = a.frame.origin - b.frame.origin, moving = c.a.velocity - c.b.velocity,
             turned = rotation_vector(a.frame.rotation * transposed(b.frame.rotation)),
             turning = c.a.spin - c.b.spin;
  const double errors[6] = {apart.x, apart.y, apart.z, turned.x, turned.y, turned.z};
  const double standing[6] = {moving.x, moving.y, moving.z, turning.x, turning.y, turning.z};
  for (int i = 0; i < (c.kind == ConstraintKind::fixed ? 6 : 3); ++i) {
    ConstraintRow row{dense::Numbers(n), errors[i], standing[i], c.most};
    for (int k = 0; k < n; ++k) row.direction[k] = a.jacobian[i * n + k] - b.jacobian[i * n + k];
    rows.push_back(row);
  }
}

}  // namespace bt
