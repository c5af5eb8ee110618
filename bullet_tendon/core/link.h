// A pybullet link as the core sees it: a placement that moves, a response to forces, and the wrench
// that the tendons put on it.
#pragma once
#include "observer.h"
#include "vec.h"

namespace bt {

struct Link {
  Pose pose;                    // of the URDF link frame, at the start of the step
  Vec3 centre;                  // centre of mass, world [m]
  Vec3 velocity, spin;          // foreseen for the end of the step, but for the tendons [m/s], [rad/s]
  Vec3 now_velocity, now_spin;  // at its start
  bool yields = false;          // answers to forces within the step
  bool falls = false;           // gravity's change of its velocity is not in its response
  double free[6][6] = {};       // inverse inertia at the centre of mass, world axes (linear, angular)
  double response[6][6] = {};   // the same, of what something else leaves free
  Vec3 gyration;                // its gyroscopic acceleration in this step [rad/s^2]
  Observer observer;
  int touches = 0;                 // contacts and attachments that shared the response in the last step
  int touching = 0;                // the same, counted in this step
  Vec3 force, torque;              // wrench about the centre of mass [N], [N m]
  Vec3 usual_force, usual_torque;  // their slow averages over the last steps

  // Velocity and response of the step, from what was observed of the link.
  void foresee(double dt, Vec3 gravity);
  // -I^-1 (w x I w) of a free body, by the angular block I^-1 of its response [rad/s^2].
  Vec3 gyroscopic() const;
  // Acceleration of the point p by the usual wrench [m/s^2].
  Vec3 usual_acceleration(Vec3 p) const;
  // The impulse j at the point p changes its motion, as if it was alone.
  void push(Vec3 j, Vec3 p);
  // Goes on for dt.
  void advance(double dt);
  // Displacement of the world point p within dt, were it not for the tendons.
  Vec3 drift(Vec3 p, double dt) const { return dt * (velocity + cross(spin, p - centre)); }
  // Response of the point p to a force there: W = [I, -[r]] R [I, -[r]]^T [1/kg].
  Sym3 mobility(Vec3 p) const { return yields ? point_mobility(response, p) : Sym3{}; }
  // The same if nothing held the link.
  Sym3 free_mobility(Vec3 p) const { return yields ? point_mobility(free, p) : Sym3{}; }
  void apply(Vec3 f, Vec3 p) {
    force += f;
    torque += cross(p - centre, f);
  }

 private:
  Sym3 point_mobility(const double (&of)[6][6], Vec3 p) const;
};

inline void Link::foresee(double dt, Vec3 gravity) {
  const double* r = observer.push().v;
  velocity = now_velocity + dt * (Vec3{r[0], r[1], r[2]} + (falls ? 1.0 : 0.0) * gravity);
  spin = now_spin + dt * (Vec3{r[3], r[4], r[5]} + gyration);
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j) response[i][j] = observer.response().m[i][j];
}

inline Vec3 Link::gyroscopic() const {
  const Sym3 turning{free[3][3], free[3][4], free[3][5], free[4][4], free[4][5], free[5][5]};
  if (!(turning.xx > 0 && turning.yy > 0 && turning.zz > 0)) return {};
  return -(turning * cross(now_spin, inverse(turning) * now_spin));
}

inline Vec3 Link::usual_acceleration(Vec3 p) const {
  const double w[6] = {usual_force.x,  usual_force.y,  usual_force.z,
                       usual_torque.x, usual_torque.y, usual_torque.z};
  double a[6] = {};
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) a[r] += response[r][c] * w[c];
  return Vec3{a[0], a[1], a[2]} + cross(Vec3{a[3], a[4], a[5]}, p - centre);
}

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

inline Sym3 Link::point_mobility(const double (&of)[6][6], Vec3 p) const {
  Vec3 r = p - centre;
  Vec3 column[3];
  for (int c = 0; c < 3; ++c) {
    Vec3 f{c == 0 ? 1.0 : 0, c == 1 ? 1.0 : 0, c == 2 ? 1.0 : 0}, t = cross(r, f);
    const double w[6] = {f.x, f.y, f.z, t.x, t.y, t.z};
    double a[6] = {};
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j) a[i] += of[i][j] * w[j];
    column[c] = Vec3{a[0], a[1], a[2]} + cross(Vec3{a[3], a[4], a[5]}, r);
  }
  return {column[0].x, 0.5 * (column[1].x + column[0].y), 0.5 * (column[2].x + column[0].z),
          column[1].y, 0.5 * (column[2].y + column[1].z), column[2].z};
}

}  // namespace bt
