#include "tendon/bending.h"

#include <algorithm>

namespace bt {

namespace {

void add_outer(Mat3& a, double w, Vec3 x, Vec3 y) {
  const double r[3] = {x.x, x.y, x.z}, c[3] = {y.x, y.y, y.z};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) a.m[3 * i + j] += w * r[i] * c[j];
}

void add_identity(Mat3& a, double w) {
  a.m[0] += w;
  a.m[4] += w;
  a.m[8] += w;
}

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

// Adds the part of the second derivatives of c that remains for a small angle between the segments, times
// w. It is used where the rest could be negative.
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
  if (1 + c < kSharpest) {  // continue along the tangent
    b.energy = k * (2 - kSharpest) / kSharpest + first * (1 + c - kSharpest);
    second = 0;
  }
  b.de = first * p;
  b.df = first * q;
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

namespace {

// One element: first particles of its two segments (-1: the fixed direction of a clamp), and its k [J].
struct Element {
  int e0 = -1, f0 = -1;  // e from e0 to e0 + 1, f from f0 to f0 + 1
  Vec3 fixed;
  double k = 0;
};

Bend evaluate(const Element& el, const Field& x, bool hessian, bool definite) {
  Vec3 e = el.e0 < 0 ? el.fixed : x.at(el.e0 + 1) - x.at(el.e0);
  Vec3 f = el.f0 < 0 ? el.fixed : x.at(el.f0 + 1) - x.at(el.f0);
  return bend(e, f, el.k, hessian, definite);
}

template <class Visit>
void each_element(const Tendon& c, Visit visit) {
  const double twice = 2 * c.material.bending_stiffness;
  const int n = c.n();
  for (int j = 0; j + 2 < n; ++j) visit(Element{j, j + 1, {}, twice / (0.5 * (c.rest[j] + c.rest[j + 1]))});
  for (const Anchor& h : c.anchors) {
    if (!h.clamped) continue;
    if (h.particle == 0) visit(Element{-1, 0, h.direction, twice / (0.5 * c.rest[0])});
    if (h.particle == n - 1) visit(Element{n - 2, -1, h.direction, twice / (0.5 * c.rest[n - 2])});
  }
}

Sym3 symmetric(const Mat3& a) {
  const double* m = a.m;
  return {m[0], 0.5 * (m[1] + m[3]), 0.5 * (m[2] + m[6]), m[4], 0.5 * (m[5] + m[7]), m[8]};
}

void add_below(Band& b, int i, int offset, double w, const Mat3& a) {
  for (int k = 0; k < 9; ++k) b.below[offset - 1][k][i] += w * a.m[k];
}

Vec3 times(const Mat3& a, Vec3 v) {
  const double* m = a.m;
  return {m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z,
          m[6] * v.x + m[7] * v.y + m[8] * v.z};
}

Vec3 transposed_times(const Mat3& a, Vec3 v) {
  const double* m = a.m;
  return {m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z,
          m[2] * v.x + m[5] * v.y + m[8] * v.z};
}

}  // namespace

bool bends(const Tendon& c) { return c.material.bending_stiffness > 0; }

double bending_energy(const Tendon& c, const Field& x) {
  double sum = 0;
  if (bends(c)) each_element(c, [&](const Element& el) { sum += evaluate(el, x, false, false).energy; });
  return sum;
}

void add_bending_forces(Tendon& c, const Field& x) {
  if (!bends(c)) return;
  each_element(c, [&](const Element& el) {
    const Bend b = evaluate(el, x, false, false);
    if (el.e0 >= 0) {
      c.residual.add(el.e0, -b.de);
      c.residual.add(el.e0 + 1, b.de);
    }
    if (el.f0 >= 0) {
      c.residual.add(el.f0, -b.df);
      c.residual.add(el.f0 + 1, b.df);
    }
  });
}

// With segments e = x_1 - x_0 and f = x_2 - x_1, the blocks between particles are
//   00: ee,  10: fe - ee,  11: ee - fe - fe^T + ff,  20: -fe,  21: fe - ff,  22: ff.
void add_bending_blocks(Tendon& c, const Field& x, bool definite) {
  if (!bends(c)) return;
  Band& m = c.matrix;
  auto own = [&](int i, const Mat3& a) {  // dee or dff, of the segment that starts at particle i
    m.add(i, symmetric(a));
    m.add(i + 1, symmetric(a));
    add_below(m, i, 1, -1, a);
  };
  each_element(c, [&](const Element& el) {
    const Bend b = evaluate(el, x, true, definite);
    if (el.e0 >= 0) own(el.e0, b.dee);
    if (el.f0 >= 0) own(el.f0, b.dff);
    if (el.e0 < 0 || el.f0 < 0) return;
    const int j = el.e0;
    m.add(j + 1, -2.0 * symmetric(b.dfe));
    add_below(m, j, 1, 1, b.dfe);
    add_below(m, j + 1, 1, 1, b.dfe);
    add_below(m, j, 2, -1, b.dfe);
  });
}

Vec3 bending_force_after(const Tendon& c, const Field& x, const Field& u, int i) {
  Vec3 force;
  if (!bends(c)) return force;
  each_element(c, [&](const Element& el) {
    const bool in_e = el.e0 >= 0 && (i == el.e0 || i == el.e0 + 1);
    const bool in_f = el.f0 >= 0 && (i == el.f0 || i == el.f0 + 1);
    if (!in_e && !in_f) return;
    const Bend b = evaluate(el, x, true, true);
    const Vec3 ue = el.e0 >= 0 ? u.at(el.e0 + 1) - u.at(el.e0) : Vec3{};
    const Vec3 uf = el.f0 >= 0 ? u.at(el.f0 + 1) - u.at(el.f0) : Vec3{};
    const Vec3 ge = b.de + times(b.dee, ue) + transposed_times(b.dfe, uf);
    const Vec3 gf = b.df + times(b.dff, uf) + times(b.dfe, ue);
    if (in_e) force += (i == el.e0 ? 1.0 : -1.0) * ge;
    if (in_f) force += (i == el.f0 ? 1.0 : -1.0) * gf;
  });
  return force;
}

}  // namespace bt
