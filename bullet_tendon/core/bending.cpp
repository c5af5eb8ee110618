#include "bending.h"

namespace bt {

namespace {

void add_outer(Mat3& a, double w, Vec3 x, Vec3 y) {
  const double r[3] = {x.x, x.y, x.z}, c[3] = {y.x, y.y, y.z};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) a.m[3 * i + j] += w * r[i] * c[j];
}

void add_identity(Mat3& a, double w) { a.m[0] += w, a.m[4] += w, a.m[8] += w; }

// w (I - n n^T)
void add_across(Mat3& a, double w, Vec3 n) {
  add_identity(a, w);
  add_outer(a, -w, n, n);
}

// d2c/de2 = -(t p^T + p t^T)/|e| - c (I - t t^T)/|e|^2, times w.
void add_own(Mat3& a, double w, Vec3 t, Vec3 p, double c, double inverse) {
  add_outer(a, -w * inverse, t, p);
  add_outer(a, -w * inverse, p, t);
  add_across(a, -w * c * inverse * inverse, t);
}

// The same where the turn is small, which is what is left when the rest could be negative.
void add_small_turn(Bend& b, double w, Vec3 t, Vec3 u, double ie, double jf) {
  add_across(b.dee, w * ie * ie, t);
  add_across(b.dff, w * jf * jf, u);
  // -(I - u u^T)(I - t t^T)/(|e| |f|)
  const double s = -w * ie * jf;
  add_identity(b.dfe, s);
  add_outer(b.dfe, -s, u, u);
  add_outer(b.dfe, -s, t, t);
  add_outer(b.dfe, s * dot(u, t), u, t);
}

}  // namespace

Bend bend(Vec3 e, Vec3 f, double k, bool hessian, bool definite) {
  Bend b;
  const double le = norm(e), lf = norm(f);
  if (!(le > 0) || !(lf > 0)) return b;
  const double ie = 1 / le, jf = 1 / lf;
  const Vec3 t = ie * e, u = jf * f;
  const double c = dot(t, u), open = std::max(1 + c, kSharpest);
  const Vec3 p = ie * (u - c * t), q = jf * (t - c * u);
  const double first = -2 * k / (open * open);
  double second = 4 * k / (open * open * open);
  b.energy = k * (1 - c) / open;
  if (1 + c < kSharpest) {  // on along the tangent
    b.energy = k * (2 - kSharpest) / kSharpest + first * (1 + c - kSharpest);
    second = 0;
  }
  b.de = first * p, b.df = first * q;
  if (!hessian) return b;
  add_outer(b.dee, second, p, p);
  add_outer(b.dff, second, q, q);
  add_outer(b.dfe, second, q, p);
  if (definite) {
    add_small_turn(b, -first, t, u, ie, jf);
    return b;
  }
  add_own(b.dee, first, t, p, c, ie);
  add_own(b.dff, first, u, q, c, jf);
  // d2c/df de = (I - t t^T)/(|e| |f|) - u p^T/|f|, rows f, columns e
  add_across(b.dfe, first * ie * jf, t);
  add_outer(b.dfe, -first * jf, u, p);
  return b;
}

}  // namespace bt
