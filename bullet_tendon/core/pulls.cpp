// Segments that turn far within a step, and get longer by that, as those that turn within an iteration do
// (turning.cpp). What inertia outweighs is moved least by the pulls tau that it takes to give each segment
// the length m back that the solution meant: with w = b^2/mass, 0 of what is held, and k the springs' slopes,
//
//   x_k += w_k (tau_k u_k - tau_k-1 u_k-1),     tau_k = k_k (length_k - m_k) at the new positions,
//
// of which one Newton step is tridiagonal,
//
//   (1 + k_k (w_k + w_k+1)) tau_k - k_k (w_k u_k.u_k-1 tau_k-1 + w_k+1 u_k.u_k+1 tau_k+1) = s_k,
//
// with s_k = k_k (length_k - m_k). The shift is of second order in the solution: it changes how fast Newton's
// method gets to the fixed point, not the fixed point.
//
// The guess that a step begins with is made alike: with the lengths as they are, and then with the pulls that
// answer what it leaves unbalanced, r = M (x - y)/b^2 - f, as Newton's method would without the geometric
// part of its matrix: s_k = k_k u_k.(w_k r_k - w_k+1 r_k+1). As it is without, particles go half that way.
#include "pulls.h"

namespace bt {

void weigh(const Chain& c, Pulls& p) {
  for (int i = 0; i < c.n(); ++i) p.w[i] = c.b * c.b / c.mass[i];
  for (const Hold& h : c.holds) p.w[h.particle] = 0;
}

namespace {

BT_VECTOR void find_directions(const Chain& c, Pulls& p) {
  const double *x = c.next[0], *y = c.next[1], *z = c.next[2];
  const double *tx = c.next_tail[0], *ty = c.next_tail[1], *tz = c.next_tail[2];
  double *ux = p.u[0], *uy = p.u[1], *uz = p.u[2];
#pragma GCC ivdep
  for (int k = 0; k < c.structure.count; ++k) {
    const double dx = x[k + 1] - x[k] + (tx[k + 1] - tx[k]), dy = y[k + 1] - y[k] + (ty[k + 1] - ty[k]),
                 dz = z[k + 1] - z[k] + (tz[k + 1] - tz[k]);
    const double length = std::sqrt(dx * dx + dy * dy + dz * dz), inverse = length > 0 ? 1 / length : 0;
    p.length[k] = length, ux[k] = inverse * dx, uy[k] = inverse * dy, uz[k] = inverse * dz;
  }
  p.along[0] = 0;
#pragma GCC ivdep
  for (int k = 1; k < c.structure.count; ++k)
    p.along[k] = ux[k] * ux[k - 1] + uy[k] * uy[k - 1] + uz[k] * uz[k - 1];
}

// From the right-hand side in tau (Thomas).
void solve_pulls(const SpringSet& s, Pulls& p) {
  const int m = s.count;
  double above = 0, last = 0;
  for (int k = 0; k < m; ++k) {
    const double slope = std::max(s.slope[k], 0.0), lower = -slope * p.w[k] * p.along[k];
    const double inverse = 1 / (1 + slope * (p.w[k] + p.w[k + 1]) - lower * above);
    p.tau[k] = last = inverse * (p.tau[k] - lower * last);
    p.above[k] = above = k + 1 < m ? -inverse * slope * p.w[k + 1] * p.along[k + 1] : 0;
  }
  for (int k = m - 2; k >= 0; --k) p.tau[k] -= p.above[k] * p.tau[k + 1];
}

// Multipliers follow, and particles go a share of the way.
BT_VECTOR void pull(Chain& c, const Pulls& p, double share) {
  SpringSet& s = c.structure;
  const double elastic = 1 / (1 + c.material.damping / (c.material.stiffness * c.b));
#pragma GCC ivdep
  for (int k = 0; k < s.count; ++k) s.carried[k] += p.tau[k], s.elastic[k] += elastic * p.tau[k];
  for (int e = 0; e < 3; ++e) {
    double *x = c.next[e], *tail = c.next_tail[e];
    const double* u = p.u[e];
    double last = 0;
    for (int k = 0; k <= s.count; ++k) {
      const double way = k < s.count ? share * p.tau[k] * u[k] : 0;
      add_exactly(x[k], tail[k], p.w[k] * (way - last));
      last = way;
    }
  }
}

void shorten(Chain& c, Pulls& p) {
  const SpringSet& s = c.structure;
  for (int k = 0; k < s.count; ++k) p.tau[k] = std::max(s.slope[k], 0.0) * p.too_long[k];
  solve_pulls(s, p);
  pull(c, p, 1);
}

// Of the guess, with the multipliers as the springs' forces.
void find_unbalanced(const Chain& c, Pulls& p) {
  for (int i = 0; i < c.n(); ++i)
    p.unbalanced.set(i, c.mass[i] / (c.b * c.b) * (c.next.at(i) - c.goal.at(i)));
  for (int k = 0; k < c.structure.count; ++k) {
    const Vec3 force = c.structure.carried[k] * p.u.at(k);
    p.unbalanced.add(k, -force), p.unbalanced.add(k + 1, force);
  }
}

void balance(Chain& c, Pulls& p) {
  const SpringSet& s = c.structure;
  find_directions(c, p);
  find_unbalanced(c, p);
  for (int k = 0; k < s.count; ++k) {
    const Vec3 apart = p.w[k] * p.unbalanced.at(k) - p.w[k + 1] * p.unbalanced.at(k + 1);
    p.tau[k] = std::max(s.slope[k], 0.0) * dot(p.u.at(k), apart);
  }
  solve_pulls(s, p);
  for (int i = 0; i < c.n(); ++i) c.next.add(i, (-0.5 * p.w[i]) * p.unbalanced.at(i));
  pull(c, p, 0.5);
}

}  // namespace

void keep_present(Chain& c, Pulls& p) {
  find_directions(c, p);
  for (int k = 0; k < c.structure.count; ++k)
    p.too_long[k] = p.length[k] > 0 ? p.length[k] - c.structure.length[k] : 0;
  shorten(c, p);
}

void pull_to_lengths(Chain& c) {
  const SpringSet& s = c.structure;
  Pulls p(c);
  weigh(c, p);
  find_directions(c, p);
  for (int k = 0; k < s.count; ++k) {
    const Vec3 u{s.direction[0][k], s.direction[1][k], s.direction[2][k]};
    const Vec3 d = c.step.at(k + 1) - c.step.at(k), across = d - dot(u, d) * u;
    const double meant = s.length[k] + dot(u, d);
    // What is turned over or collapsed stays as it is. As in turning.cpp.
    p.too_long[k] = meant > 0 && p.length[k] > 0 ? dot(across, across) / (p.length[k] + meant) : 0;
  }
  shorten(c, p);
}

void guess_turned(Chain& c) {
  Pulls p(c);
  measure(c.structure, c.x);
  weigh(c, p);
  keep_present(c, p);
  balance(c, p);
  keep_present(c, p);
}

}  // namespace bt
