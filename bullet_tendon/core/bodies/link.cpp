#include "bodies/link.h"

#include <algorithm>

namespace bt {

namespace {

// The product of a matrix (6 n) and the vector x (n).
Twist times(const dense::Numbers& a, const dense::Numbers& x) {
  double sums[6];
  dense::of_size(static_cast<int>(x.size()), [&](auto n) {
    for (int r = 0; r < 6; ++r) {
      sums[r] = 0;
      for (int k = 0; k < n; ++k) sums[r] += a[r * n + k] * x[k];
    }
  });
  return {{sums[0], sums[1], sums[2]}, {sums[3], sums[4], sums[5]}};
}

}  // namespace

Twist Link::rates_after(const dense::Numbers& d) const {
  const Twist more = jacobian.empty() ? Twist{{d[0], d[1], d[2]}, {d[3], d[4], d[5]}} : times(jacobian, d);
  return rates + more;
}

// pybullet moves a link by the length of a step times its velocity v at the end. If the step ended at the
// time t, the link would have moved by t v(t). In a substep it moves by t1 v1 - t0 v0.
void Link::begin_substep(const GeneralizedBody* m, double before, double at_end) {
  Twist at_start = drift_rates;
  if (m) {
    at_start = rates_after(m->substep.changed);
    const Twist end = rates_after(m->substep.changes_to);
    drift_rates = end + (before / (at_end - before)) * (end - at_start);
  }
  iterate.turned = {};
  iterate.turned.begin(m ? m->inertia.slender_axis : Vec3{}, before * at_start.angular,
                       (at_end - before) * drift_rates.angular);
}

void Link::go_with(const GeneralizedBody& m) {
  drift_rates = rates_after(m.change);
  if (jacobian.empty())
    root = m.root;
  else
    dense::product(m.n(), jacobian, m.root, root);
}

void Link::advance_to(const GeneralizedBody* m, double time) {
  const Vec3 arm = transposed_times(start.pose.rotation, start.pose.origin - start.centre);
  const Twist mean = m ? rates_after(m->substep.changes_to) : drift_rates;
  const double angle = time * norm(mean.angular);
  pose.rotation = start.pose.rotation;
  if (angle > 0 && jacobian.empty())
    pose.rotation = rotation_of_step(time * mean.angular) * pose.rotation;
  else if (angle > 0)
    pose.rotation = rotation_about(unit_or(mean.angular, {0, 0, 1}), angle) * pose.rotation;
  centre = start.centre + time * mean.linear;
  pose.origin = centre + pose.rotation * arm;
}

// The angular rows of `reached` are those of the root, times Q (bodies/finite_rotation.h).
void Link::turn(const GeneralizedBody& m) {
  FiniteRotation& turned = iterate.turned;
  dense::Numbers& reached = iterate.reached;
  turned.turn_by(iterate.given.angular);
  const size_t n = m.n();
  reached = root;
  for (size_t k = 0; k < n; ++k) {
    const Vec3 d = turned.rate * Vec3{root[3 * n + k], root[4 * n + k], root[5 * n + k]};
    reached[3 * n + k] = d.x;
    reached[4 * n + k] = d.y;
    reached[5 * n + k] = d.z;
  }
}

LinkEnd Link::end(double dt, double time) const {
  LinkEnd end{centre + dt * drift_rates.linear, iterate.turned.rotation};
  const Vec3 spin = drift_rates.angular;
  if (!yields()) end.rotation = rotation_about(unit_or(spin, {0, 0, 1}), dt * norm(spin));
  if (yields()) end.centre += iterate.given.linear + (0.5 * dt * (2 * time - dt)) * curving;
  return end;
}

Vec3 Link::ahead_of(Vec3 local, double dt) const {
  const Vec3 p = to_world(pose, local);
  if (!attachment_arms.at_end) return p + drift(p, dt);
  const Vec3 arm = held_arm_of(local), more = drift_rates.angular - rates.angular;
  return centre + dt * drift_rates.linear + (0.5 * dt * dt) * curving + arm + cross(dt * more, arm);
}

Vec3 Link::displaced(Vec3 arm) const {
  if (!iterate.turned.far) return iterate.given.at(arm);
  return iterate.given.linear + (now(arm) - arm) - cross(iterate.turned.more, arm);
}

void Link::foresee(const Twist& by, double dt, bool far) {
  const Twist all = dt * drift_rates + by;
  const FiniteRotation& turned = iterate.turned;
  const Rot3 turn = far ? turned.since_begun(turned.predicted + by.angular) : rotation_by(all.angular);
  foreseen = {all, by, turn, far};
}

Vec3 Link::displaced_from_foreseen(Vec3 arm) const {
  const Twist more = iterate.given - foreseen.given;
  return iterate.turned.far ? more.linear + now(arm) - foreseen.turn * arm : more.at(arm);
}

Rot3 Link::turned_from_foreseen() const {
  if (iterate.turned.far) return iterate.turned.rotation * transposed(foreseen.turn);
  return rotation_by((iterate.given - foreseen.given).angular);
}

Vec3 Link::torque_of(Vec3 f, Vec3 arm) const {
  return transposed_times(iterate.turned.rate, cross(now(arm), f));
}

Twist Link::twist_of(const dense::Numbers& y) const { return times(iterate.reached, y); }

Twist Link::spin_of(const dense::Numbers& y) const { return times(root, y); }

void Link::add_generalized(const dense::Numbers& by, const Wrench& w, dense::Numbers& to) const {
  const size_t n = to.size();
  const double wrench[6] = {w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z};
  if (by.empty()) {  // the identity
    for (size_t k = 0; k < std::min<size_t>(n, 6); ++k) to[k] += wrench[k];
    return;
  }
  dense::add_rows(by, 6, wrench, to);
}

// B B^T / s^2 with B = s [I, -[r]] root.
Sym3 Link::mobility(Vec3 p) const {
  if (!yields()) return {};
  const Vec3 r = p - centre;
  const size_t n = root.size() / 6;
  Sym3 sum;
  for (size_t k = 0; k < n; ++k) {
    auto at = [&](size_t row) { return root[row * n + k]; };
    sum += outer(Vec3{at(0), at(1), at(2)} + cross(Vec3{at(3), at(4), at(5)}, r));
  }
  return sum;
}

Pose Link::foreseen_pose(const Pose& frame) const {
  return {foreseen.turn * frame.rotation,
          centre + foreseen.all.linear + foreseen.turn * (frame.origin - centre)};
}

Vec3 Link::foreseen_point(Vec3 x) const {
  return foreseen.far ? foreseen_pose({{}, x}).origin : x + foreseen_at(x);
}

void Link::note_motion() {
  const bool elsewhere = !same(pose, start.pose);
  moved |= !rests() || elsewhere;
  put = {};
  if (elsewhere && start.known && drift_rates.is_zero() && rests())
    put = {centre - start.centre, rotation_vector(pose.rotation * transposed(start.pose.rotation))};
}

}  // namespace bt
