#include "bodies/articulated_body.h"

#include <algorithm>
#include <vector>

#include "math/small_matrix.h"

namespace bt {

namespace {

// Way to a limit that a joint does not have [rad], [m].
constexpr double kNoLimit = 1e6;

int count_of(JointKind kind) { return kind == JointKind::fixed ? 0 : kind == JointKind::ball ? 3 : 1; }

}  // namespace

Articulated::Articulated(const std::vector<Joint>& joints, const std::vector<bool>& floating)
    : joints_(joints), floating_(floating), links_(floating.size() + joints.size()) {
  for (int tree = 0; tree < trees(); ++tree) {
    links_[tree].tree = tree;
    for (int k = 0; k < 6 && floating[tree]; ++k) {
      links_[tree].moved_by.push_back(dofs());
      twists_.push_back({tree, k < 3, unit_axis(k % 3), {}, {}, 1, 0, 0, 0});
    }
  }
  base_ = dofs();
  for (int j = 0; j < static_cast<int>(joints.size()); ++j) {
    const Joint& joint = joints[j];
    Placed& link = links_[trees() + j];
    link.moved_by = links_[joint.parent].moved_by;
    link.tree = links_[joint.parent].tree;
    for (int k = 0; k < count_of(joint.kind); ++k) {
      const Vec3 axis = joint.kind == JointKind::ball ? unit_axis(k) : joint.axis;
      const bool slides = joint.kind == JointKind::slider;
      link.moved_by.push_back(dofs());
      twists_.push_back(
          {trees() + j, slides, axis, {}, {}, joint.lower, joint.upper, joint.damping, places_});
    }
    places_ += joint.kind == JointKind::ball ? 4 : count_of(joint.kind);
  }
}

void Articulated::place_inertia(Placed& link, const LinkInertia& inertia) {
  link.mass = inertia.mass;
  link.inertia = turned(link.turn, inertia.moments);
}

void Articulated::place(const std::vector<LinkInertia>& inertias, const double* bases, const double* places) {
  base_at_ = {bases[0], bases[1], bases[2]};
  for (int tree = 0; tree < trees(); ++tree) {
    const double* base = bases + 7 * tree;
    Placed& root = links_[tree];
    root.turn = rotation_of(base + 3);
    root.frame = root.turn * transposed(inertias[tree].turn);
    root.centre = Vec3{base[0], base[1], base[2]} - base_at_;
    root.joint = root.centre - root.frame * inertias[tree].centre;
    place_inertia(root, inertias[tree]);
  }
  for (int j = 0; j < static_cast<int>(joints_.size()); ++j) {
    const Joint& joint = joints_[j];
    const Placed& parent = links_[joint.parent];
    const LinkInertia& inertia = inertias[trees() + j];
    Placed& link = links_[trees() + j];
    link.turn = parent.turn * joint.turn;
    link.joint = parent.centre + parent.turn * joint.pivot;
    if (joint.kind == JointKind::hinge)
      link.turn = link.turn * rotation_about(unit_or(joint.axis, {0, 0, 1}), *places++);
    else if (joint.kind == JointKind::slider)
      link.joint += *places++ * (link.turn * joint.axis);
    else if (joint.kind == JointKind::ball) {
      link.turn = link.turn * rotation_of(places);
      places += 4;
    }
    link.frame = link.turn * transposed(inertia.turn);
    link.centre = link.joint + link.frame * inertia.centre;
    place_inertia(link, inertia);
  }
  for (int k = 0; k < dofs(); ++k) {
    Twist& t = twists_[k];
    const Placed& link = links_[t.carried];
    const Vec3 axis = k < base_ ? t.axis : link.turn * t.axis, through = k < base_ ? link.centre : link.joint;
    t.spin = t.slides ? Vec3{} : axis;
    t.velocity = t.slides ? axis : cross(through, axis);
  }
}

void Articulated::jacobian(int link, double* out) const {
  const int n = dofs();
  std::fill(out, out + 6 * n, 0.0);
  for (int k : links_[link].moved_by) {
    const Vec3 w = twists_[k].spin, v = twists_[k].velocity + cross(w, links_[link].centre);
    const double column[6] = {v.x, v.y, v.z, w.x, w.y, w.z};
    for (int i = 0; i < 6; ++i) out[i * n + k] = column[i];
  }
}

void Articulated::weight(double* out) const {
  std::fill(out, out + 3 * dofs(), 0.0);
  for (const Placed& link : links_)
    for (int k : link.moved_by) {
      const Vec3 v = link.mass * (twists_[k].velocity + cross(twists_[k].spin, link.centre));
      out[3 * k] += v.x;
      out[3 * k + 1] += v.y;
      out[3 * k + 2] += v.z;
    }
}

void Articulated::mass_matrix(double* out) const {
  const int n = dofs();
  std::fill(out, out + n * n, 0.0);
  std::vector<Vec3> velocity(n);
  for (const Placed& link : links_) {
    for (std::size_t a = 0; a < link.moved_by.size(); ++a) {
      const int i = link.moved_by[a];
      velocity[i] = twists_[i].velocity + cross(twists_[i].spin, link.centre);
      const Vec3 momentum = link.mass * velocity[i], turning = link.inertia * twists_[i].spin;
      for (std::size_t b = 0; b <= a; ++b) {
        const int j = link.moved_by[b];
        out[i * n + j] += dot(momentum, velocity[j]) + dot(turning, twists_[j].spin);
      }
    }
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < i; ++j) out[j * n + i] = out[i * n + j];
}

std::vector<Articulated::Motion> Articulated::motions_at(const double* rates) const {
  std::vector<Motion> motions(links_.size());
  for (int k = 0; k < base_; ++k) {
    Motion& base = motions[twists_[k].carried];
    base.velocity += rates[k] * twists_[k].velocity;
    base.spin += rates[k] * twists_[k].spin;
  }
  // The rates of a base are the velocity of its centre of mass, which moves away from the point of reference.
  for (int tree = 0; tree < trees(); ++tree) {
    Motion& base = motions[tree];
    base.acceleration = -cross(base.spin, base.velocity + cross(base.spin, links_[tree].centre));
  }
  int k = base_;
  for (size_t j = 0; j < joints_.size(); ++j) {
    const Motion& parent = motions[joints_[j].parent];
    Vec3 velocity, spin;  // across the joint
    Motion& link = motions[trees() + j];
    for (; k < dofs() && twists_[k].carried == trees() + static_cast<int>(j); ++k) {
      velocity += rates[k] * twists_[k].velocity;
      spin += rates[k] * twists_[k].spin;
    }
    link.velocity = parent.velocity + velocity;
    link.spin = parent.spin + spin;
    link.turning = parent.turning + cross(parent.spin, spin);
    link.acceleration = parent.acceleration + cross(parent.spin, velocity) + cross(parent.velocity, spin);
  }
  return motions;
}

void Articulated::velocity_force(const double* rates, double* out) const {
  inertial_force(rates, out);
  for (int k = 0; k < dofs(); ++k) out[k] -= twists_[k].damping * rates[k];
}

void Articulated::inertial_force(const double* rates, double* out) const {
  std::fill(out, out + dofs(), 0.0);
  const std::vector<Motion> motions = motions_at(rates);
  for (size_t l = 0; l < links_.size(); ++l) {
    const Placed& link = links_[l];
    const Motion& m = motions[l];
    const Vec3 velocity = m.velocity + cross(m.spin, link.centre);
    const Vec3 force = link.mass * (m.acceleration + cross(m.turning, link.centre) + cross(m.spin, velocity));
    const Vec3 torque = link.inertia * m.turning + cross(m.spin, link.inertia * m.spin);
    for (int k : link.moved_by)
      out[k] -= dot(force, twists_[k].velocity + cross(twists_[k].spin, link.centre)) +
                dot(torque, twists_[k].spin);
  }
}

void Articulated::curvings(const double* rates, std::vector<Vec3>& out) const {
  const std::vector<Motion> motions = motions_at(rates);
  out.clear();
  for (size_t l = 0; l < links_.size(); ++l) {
    const Motion& m = motions[l];
    const Vec3 velocity = m.velocity + cross(m.spin, links_[l].centre);
    out.push_back(m.acceleration + cross(m.turning, links_[l].centre) + cross(m.spin, velocity));
  }
}

void Articulated::limits(const double* places, std::vector<double>& out) const {
  out.clear();
  for (int k = base_; k < dofs(); ++k) {
    const Twist& t = twists_[k];
    const bool limited = t.lower <= t.upper;
    const double place = places[t.place];
    out.insert(out.end(), {double(k), 1, limited ? t.lower - place : -kNoLimit, double(k), -1,
                           limited ? place - t.upper : -kNoLimit});
  }
}

Articulated::JointForce Articulated::force_of(int dof, double amount) const {
  const Twist& t = twists_[dof];
  const Vec3 linear = t.slides ? t.velocity : Vec3{};
  const Placed& link = links_[t.carried];
  if (dof < base_) return {t.carried, -1, amount * linear, centre(t.carried), amount * t.spin};
  return {t.carried, joints_[t.carried - trees()].parent, amount * linear, base_at_ + link.joint,
          amount * t.spin};
}

void answer(int n, int columns, const double* mass, double* b) {
  const dense::Numbers matrix(mass, mass + static_cast<size_t>(n) * n);
  dense::Numbers root, x(n);
  dense::root(n, matrix, root);
  for (int c = 0; c < columns; ++c) {
    for (int i = 0; i < n; ++i) x[i] = b[i * columns + c];
    dense::solve(root, x);
    for (int i = 0; i < n; ++i) b[i * columns + c] = x[i];
  }
}

}  // namespace bt
