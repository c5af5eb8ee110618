// Bending stiffness: a discrete curvature energy between neighbouring segments, without twist. With the
// segments e, f of rest lengths l_e, l_f, and l the mean of both,
//
//   kappa = |f/l_f - e/l_e| / l,   E = EI l kappa^2 / 2.
//
// It is quadratic in the positions (Bergou et al. 2006, "A quadratic bending model for inextensible
// surfaces"), and where segments have their rest lengths, kappa = 2 sin(theta/2)/l with theta the angle
// between them. Its Hessian is constant and never negative. An energy of the angle alone would have no such
// bound at a fold, and none where a segment that carries no compression gets short. Per material length,
// kappa includes the stretch: at a strain s the bending stiffness is EI (1 + s)^2.
//
// A clamp fixes the direction t of an end: f/l_f - t, or t - e/l_e, with l half the rest length of the end
// segment, so that the moment of the end acts over its own half segment (second order in the spacing).
#include "tendon/tendon.h"

namespace bt {

namespace {

// E = stiffness |d|^2 / 2 with d the sum of weight[a] x_(first + a), and of the fixed direction of a clamp.
struct Element {
  double stiffness;  // EI/l [N m]
  int first, count;  // its particles
  double weight[3];  // [1/m]
  Vec3 fixed;

  Vec3 bend(const Field& x) const {
    Vec3 d = fixed;
    for (int a = 0; a < count; ++a) d += weight[a] * x.at(first + a);
    return d;
  }
};

template <class Visit>
void each_element(const Tendon& c, Visit visit) {
  const double EI = c.material.bending_stiffness;
  if (EI == 0) return;
  const int n = c.n();
  for (int j = 0; j + 2 < n; ++j) {
    if (!c.torn.empty() && (c.is_torn(j) || c.is_torn(j + 1))) continue;
    const double ie = 1 / c.rest[j], jf = 1 / c.rest[j + 1];
    visit(Element{2 * EI / (c.rest[j] + c.rest[j + 1]), j, 3, {ie, -ie - jf, jf}, {}});
  }
  for (const Anchor& h : c.anchors) {
    if (!h.clamped) continue;
    const int segment = h.particle == 0 ? 0 : n - 2;
    if (c.is_torn(segment)) continue;
    const double inverse = 1 / c.rest[segment], side = h.particle == 0 ? 1 : -1;
    visit(Element{2 * EI * inverse, segment, 2, {-side * inverse, side * inverse}, -side * h.direction});
  }
}

}  // namespace

double bending_energy(const Tendon& c, const Field& x) {
  double sum = 0;
  each_element(c, [&](const Element& el) {
    const Vec3 d = el.bend(x);
    sum += 0.5 * el.stiffness * dot(d, d);
  });
  return sum;
}

void add_bending_forces(Tendon& c, const Field& x) {
  each_element(c, [&](const Element& el) {
    const Vec3 moment = el.stiffness * el.bend(x);
    for (int a = 0; a < el.count; ++a) c.residual.add(el.first + a, el.weight[a] * moment);
  });
}

void add_bending_blocks(Tendon& c) {
  each_element(c, [&](const Element& el) {
    for (int a = 0; a < el.count; ++a) {
      const double k = el.stiffness * el.weight[a];
      c.matrix.add(el.first + a, identity(k * el.weight[a]));
      for (int b = a + 1; b < el.count; ++b)
        c.matrix.add_below(el.first + a, full(identity(k * el.weight[b])), b - a);
    }
  });
}

Vec3 bending_force(const Tendon& c, const Field& x, const Field& u, int i) {
  Vec3 force;
  each_element(c, [&](const Element& el) {
    const int a = i - el.first;
    if (a < 0 || a >= el.count) return;
    Element moved = el;
    moved.fixed = {};
    force -= (el.stiffness * el.weight[a]) * (el.bend(x) + moved.bend(u));
  });
  return force;
}

}  // namespace bt
