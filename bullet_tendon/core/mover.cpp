#include "mover.h"

namespace bt {

Vec3 Mover::gyroscopic() const {
  if (!falls || n() != 6) return {};
  auto at = [&](int i, int j) { return free[6 * (3 + i) + 3 + j]; };
  const Sym3 turning{at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)};
  if (!(turning.xx > 0 && turning.yy > 0 && turning.zz > 0)) return {};
  const Vec3 spin{rates[3], rates[4], rates[5]};
  return -(turning * cross(spin, inverse(turning) * spin));
}

// Acceleration without tendons and without what holds it.
const Mover::Numbers& Mover::known(Vec3 gravity) {
  known_.assign(n(), 0.0);
  if (falls) known_[0] = gravity.x, known_[1] = gravity.y, known_[2] = gravity.z;
  if (falls && n() == 6) known_[3] = gyration.x, known_[4] = gyration.y, known_[5] = gyration.z;
  return known_;
}

void Mover::sense(Vec3 gravity) {
  observer.see(rates, free, known(gravity));  // with the gyration of the step before
  gyration = gyroscopic();
}

void Mover::foresee(double dt, Vec3 gravity) {
  change = known(gravity);
  for (int i = 0; i < n(); ++i) change[i] = dt * (change[i] + observer.push()[i]);
}

void Mover::push(const Numbers& impulse) {
  dense::multiply_transposed(observer.root(), impulse, half_);
  dense::multiply(observer.root(), half_, known_);
  for (int i = 0; i < n(); ++i) change[i] += known_[i];
}

}  // namespace bt
