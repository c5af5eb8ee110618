// Where methods of second order begin anew, by a step of implicit Euler, beside contacts.
//
// BDF2 carries velocities of before an impact on: what comes at V and is stopped at a wall, h before which
// the step began, leaves it with
//
//   v_1 = V/2 - 3 h/(2 dt),     v_2 = (4 v_1 + V)/3,     ...     v_1 + (3/2) (v_2 - v_1),
//
// up to 5/4 V. A heap, where something is stopped all the time, never comes to rest by that. So BDF2 does not
// go on where what touches something changes its velocities otherwise than their last change foretold. It
// comes back one step after motion is smooth again, so that the order of smooth motion beside contacts stays.
#include "constants.h"
#include "world.h"

namespace bt {

bool goes_smoothly(const Chain& c, double dt) {
  const double creep = kCreep * c.radius;
  double jump = 0, all = 0, least = 0;
  for (int k = 0; k < 3; ++k) {
    const double *v = c.v[k], *before = c.v_before[k], *a = c.acceleration[k];
    for (int i = 0; i < c.n(); ++i) {
      const double off = v[i] - before[i] - dt * a[i];
      jump += c.mass[i] * off * off, all += c.mass[i] * (v[i] * v[i] + before[i] * before[i]);
    }
  }
  for (double m : c.mass) least += 2 * m * creep * creep;
  return jump <= kRough * all && all > least;
}

bool World::share_weights() {
  bool changed = false;
  for (bool any = is_second_order(options.integrator); any; changed |= any) {
    any = false;
    for (const Row& row : rows_) {
      if (row.b.chain < 0 || row.passes) continue;
      Chain &a = *slots_[row.a.chain], &b = *slots_[row.b.chain];
      if (a.smooth != b.smooth || (a.smooth && a.b != b.b)) a.smooth = b.smooth = false, any = true;
    }
  }
  return changed;
}

}  // namespace bt
