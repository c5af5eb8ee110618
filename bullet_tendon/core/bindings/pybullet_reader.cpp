#include "bindings/pybullet_reader.h"

#include <cmath>
#include <limits>

namespace bt {

// The frame of the URDF is the inertial one by the inverse of its local pose. Of bodies with maximal
// coordinates (body type 1) pybullet does not know that, and gives what was in memory: there both are one.
void place(Link& l, PyObject* info, PyObject* where) {
  PyObject *centre = item(where, 0), *turn = item(where, 1);
  const bool maximal = number(info, 10) == 1;
  const Rot3 local = maximal ? Rot3{} : turn_of(item(info, 4));
  l.pose.rotation = turn_of(turn) * transposed(local);
  l.centre = vector(centre);
  l.pose.origin = l.centre - (maximal ? Vec3{} : l.pose.rotation * vector(item(info, 3)));
}

void stand_still(World& w, int slot) {
  w.scene.links[slot].body = -1;
  w.scene.links[slot].jacobian.clear();
  if (w.scene.bodies[slot].n() > 0) w.scene.bodies[slot] = GeneralizedBody{};
}

bool is_finite(const World& w, int slot) {
  const Link& l = w.scene.links[slot];
  const Vec3 sum = l.pose.origin + l.centre + l.now_velocity + l.now_spin + l.pose.rotation.r0 +
                   l.pose.rotation.r1 + l.pose.rotation.r2;
  bool well = max_abs(0 * sum) == 0;
  for (const dense::Numbers* numbers : {&w.scene.bodies[slot].rates, &w.scene.bodies[slot].free})
    for (double v : *numbers) well &= std::fabs(v) <= std::numeric_limits<double>::max();
  return well;
}

}  // namespace bt
