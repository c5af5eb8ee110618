#include "observer.h"

#include <algorithm>
#include <cmath>

#include "constants.h"

namespace bt {

namespace {

Six operator*(const Six6& a, const Six& b) {
  Six c;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j) c.v[i] += a.m[i][j] * b.v[j];
  return c;
}

Six6 operator*(const Six6& a, const Six6& b) {
  Six6 c;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j)
      for (int k = 0; k < 6; ++k) c.m[i][j] += a.m[i][k] * b.m[k][j];
  return c;
}

Six operator-(const Six& a, const Six& b) {
  Six c;
  for (int i = 0; i < 6; ++i) c.v[i] = a.v[i] - b.v[i];
  return c;
}

double dot(const Six& a, const Six& b) {
  double sum = 0;
  for (int i = 0; i < 6; ++i) sum += a.v[i] * b.v[i];
  return sum;
}

Six6 identity6() {
  Six6 a;
  for (int i = 0; i < 6; ++i) a.m[i][i] = 1;
  return a;
}

// One Jacobi rotation that makes a.m[p][q] zero.
void rotate(Six6& a, Six6& vectors, int p, int q) {
  if (a.m[p][q] == 0) return;
  const double theta = (a.m[q][q] - a.m[p][p]) / (2 * a.m[p][q]);
  const double t = (theta < 0 ? -1 : 1) / (std::fabs(theta) + std::sqrt(theta * theta + 1));
  const double c = 1 / std::sqrt(t * t + 1), s = t * c;
  for (int k = 0; k < 6; ++k) {
    const double x = a.m[k][p], y = a.m[k][q];
    a.m[k][p] = c * x - s * y, a.m[k][q] = s * x + c * y;
  }
  for (int k = 0; k < 6; ++k) {
    const double x = a.m[p][k], y = a.m[q][k];
    a.m[p][k] = c * x - s * y, a.m[q][k] = s * x + c * y;
    const double u = vectors.m[k][p], w = vectors.m[k][q];
    vectors.m[k][p] = c * u - s * w, vectors.m[k][q] = s * u + c * w;
  }
}

// U f(eigenvalues) U^T of a symmetric matrix, by Jacobi's method.
template <class Function>
Six6 spectral(Six6 a, Function f) {
  Six6 u = identity6();
  for (int sweep = 0; sweep < 12; ++sweep)
    for (int p = 0; p < 6; ++p)
      for (int q = p + 1; q < 6; ++q) rotate(a, u, p, q);
  double most = 0;
  for (int i = 0; i < 6; ++i) most = std::max(most, a.m[i][i]);
  Six6 out;
  for (int k = 0; k < 6; ++k) {
    const double value = f(a.m[k][k], most);
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j) out.m[i][j] += value * u.m[i][k] * u.m[j][k];
  }
  return out;
}

Six6 root_of(const Six6& a) {
  return spectral(a, [](double e, double most) { return e > kRank * most ? std::sqrt(e) : 0.0; });
}
Six6 inverse_root_of(const Six6& a) {
  return spectral(a, [](double e, double most) { return e > kRank * most ? 1 / std::sqrt(e) : 0.0; });
}

// Size of an acceleration squared, turning weighed by the square of the radius that the response has.
double size2(const Six& a, const Six6& response) {
  double linear = 0, angular = 0, turning = 0, moving = 0;
  for (int i = 0; i < 3; ++i) {
    linear += response.m[i][i], angular += response.m[3 + i][3 + i];
    moving += a.v[i] * a.v[i], turning += a.v[3 + i] * a.v[3 + i];
  }
  return moving + (angular > 0 ? linear / angular : 0) * turning;
}

}  // namespace

void Observer::see(const Six& twist, const Six6& free, const Six& gravity) {
  released_ = false;
  if (!known_) share_ = identity6();
  if (known_ && acted_ && dt_ > 0) {
    Sample now{wrench_, {}};
    for (int i = 0; i < 6; ++i) now.acceleration.v[i] = (twist.v[i] - twist_.v[i]) / dt_ - gravity.v[i];
    released_ = held_ && was_released(now);
    if (samples_ > 0) learn(now);
    before_ = last_, last_ = now;
    samples_ = std::min(2, samples_ + 1);
    find_push();
  }
  free_ = free;
  const Six6 root = held_ ? root_of(free) : Six6{};
  effective_ = held_ ? root * share_ * root : free;
  refresh(twist);
}

void Observer::refresh(const Six& twist) { twist_ = twist, known_ = true, acted_ = false; }

void Observer::act(const Six& wrench, double dt) { wrench_ = wrench, dt_ = dt, acted_ = true; }

void Observer::forget() { *this = Observer{}; }

void Observer::let_go() {
  share_ = identity6(), effective_ = free_, held_ = released_ = false;
  push_ = Six{}, samples_ = 0;
}

// It went along the wrench, by more of its free answer than it was thought to.
bool Observer::was_released(const Sample& now) const {
  Six foreseen = effective_ * now.wrench;
  for (int i = 0; i < 6; ++i) foreseen.v[i] += push_.v[i];
  const double whole = dot(now.wrench, free_ * now.wrench);
  return dot(now.wrench, now.acceleration - foreseen) > kReleased * whole;
}

void Observer::learn(const Sample& now) {
  const Six d_wrench = now.wrench - last_.wrench, d_seen = now.acceleration - last_.acceleration;
  const Six d_free = free_ * d_wrench;
  const double news = size2(d_free, free_);
  const double whole = size2(free_ * now.wrench, free_);
  if (news <= kLeastNews * kLeastNews * whole) return;
  if (size2(d_seen - effective_ * d_wrench, free_) <= kLeastMiss * kLeastMiss * news) return;
  const Six6 root = root_of(free_);
  const Six s = root * d_wrench, e = inverse_root_of(free_) * d_seen - share_ * s;
  const double es = dot(e, s);
  // What the change of the wrench does not explain, something else did.
  if (es * es <= kLeastCosine * kLeastCosine * dot(e, e) * dot(s, s)) return;
  // What is moved by hand changes its motion whatever the wrench does, by little from step to step.
  if (es > 0 && news <= kYieldNews * kYieldNews * whole) return;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j) share_.m[i][j] += e.v[i] * e.v[j] / es;
  share_ = spectral(share_, [](double value, double) { return std::min(1.0, std::max(0.0, value)); });
  double least = 1;
  for (int i = 0; i < 6; ++i) least = std::min(least, share_.m[i][i]);
  held_ = least < 1 - kLeastNews;
  effective_ = held_ ? root * share_ * root : free_;
}

void Observer::find_push() {
  const Six now = last_.acceleration - effective_ * last_.wrench;
  const Six then = before_.acceleration - effective_ * before_.wrench;
  for (int i = 0; i < 6; ++i) {
    const double a = now.v[i], b = then.v[i];
    push_.v[i] = samples_ < 2 || a * b <= 0 ? 0 : std::fabs(a) < std::fabs(b) ? a : b;
  }
}

}  // namespace bt
