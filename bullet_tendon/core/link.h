// A pybullet link as the core sees it: a placement that moves, a response to forces, and the wrench
// that the tendons put on it.
#pragma once
#include "vec.h"

namespace bt {

struct Link {
  Pose pose;                   // of the URDF link frame, at the start of the step
  Vec3 centre;                 // centre of mass, world [m]
  Vec3 velocity, spin;         // of the centre of mass [m/s], [rad/s], with gravity's change of this step
  bool yields = false;         // answers to forces within the step
  double response[6][6] = {};  // inverse inertia at the centre of mass, world axes (linear, angular)
  int touches = 0;             // contacts and attachments that shared the response in the last step
  int touching = 0;            // the same, counted in this step
  Vec3 force, torque;          // wrench about the centre of mass [N], [N m]

  // The impulse j at the point p changes its motion, as if it was alone.
  void push(Vec3 j, Vec3 p);
  // Goes on for dt.
  void advance(double dt);
  // Displacement of the world point p within dt, were it not for the tendons.
  Vec3 drift(Vec3 p, double dt) const { return dt * (velocity + cross(spin, p - centre)); }
  // Response of the point p to a force there: W = [I, -[r]] R [I, -[r]]^T [1/kg].
  Sym3 mobility(Vec3 p) const;
  void apply(Vec3 f, Vec3 p) {
    force += f;
    torque += cross(p - centre, f);
  }
};

inline void Link::push(Vec3 j, Vec3 p) {
  if (!yields) return;
  const Vec3 t = cross(p - centre, j);
  const double w[6] = {j.x, j.y, j.z, t.x, t.y, t.z};
  double a[6] = {};
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) a[r] += response[r][c] * w[c];
  velocity += Vec3{a[0], a[1], a[2]};
  spin += Vec3{a[3], a[4], a[5]};
}

inline void Link::advance(double dt) {
  const Vec3 arm = transposed_times(pose.rotation, pose.origin - centre);
  const double angle = dt * norm(spin);
  if (angle > 0) pose.rotation = rotation_about(unit_or(spin, {0, 0, 1}), angle) * pose.rotation;
  centre += dt * velocity;
  pose.origin = centre + pose.rotation * arm;
}

inline Sym3 Link::mobility(Vec3 p) const {
  if (!yields) return {};
  Vec3 r = p - centre;
  Vec3 column[3];
  for (int c = 0; c < 3; ++c) {
    Vec3 f{c == 0 ? 1.0 : 0, c == 1 ? 1.0 : 0, c == 2 ? 1.0 : 0}, t = cross(r, f);
    const double w[6] = {f.x, f.y, f.z, t.x, t.y, t.z};
    double a[6] = {};
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j) a[i] += response[i][j] * w[j];
    column[c] = Vec3{a[0], a[1], a[2]} + cross(Vec3{a[3], a[4], a[5]}, r);
  }
  return {column[0].x, 0.5 * (column[1].x + column[0].y), 0.5 * (column[2].x + column[0].z),
          column[1].y, 0.5 * (column[2].y + column[1].z), column[2].z};
}

}  // namespace bt
