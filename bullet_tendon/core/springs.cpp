#include "springs.h"

namespace bt {

void SpringSet::resize(int reach_, int particles) {
  reach = reach_;
  count = particles > reach ? particles - reach : 0;
  for (auto* v : {&rest, &stiffness, &damping, &carried, &elastic, &start, &before, &history, &length, &force,
                  &slope, &linear, &true_elastic, &elastic_slope})
    v->assign(count, 0.0);
  direction.resize(3, count);
  block.resize(6, count);
  vector.resize(3, count);
}

void measure(SpringSet& s, const Field& x) {
  const int m = s.count, reach = s.reach;
  double *nx = s.direction[0], *ny = s.direction[1], *nz = s.direction[2], *len = s.length.data();
  const double *px = x[0], *py = x[1], *pz = x[2], *rest = s.rest.data();
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    double dx = px[k + reach] - px[k], dy = py[k + reach] - py[k], dz = pz[k + reach] - pz[k];
    double length = std::sqrt(dx * dx + dy * dy + dz * dz);
    bool degenerate = length < kDegenerateLength * rest[k];
    double inv = degenerate ? 0.0 : 1 / length;
    len[k] = length;
    nx[k] = dx * inv, ny[k] = dy * inv, nz[k] = degenerate ? 1.0 : dz * inv;
  }
}

namespace {

// True forces, and the linearisation: at the present strains (at_multiplier false) or at the
// strains of the multipliers.
template <int P>
void axial_forces(SpringSet& s, const Law& law, bool at_multiplier) {
  const int m = s.count;
  const double *len = s.length.data(), *rest = s.rest.data(), *stiffness = s.stiffness.data();
  const double* carried = s.elastic.data();
  double *force = s.force.data(), *slope = s.slope.data(), *linear = s.linear.data();
  double *elastic_slope = s.elastic_slope.data(), *truth = s.true_elastic.data();
  for (int k = 0; k < m; ++k) {
    double f, df, inv = 1 / rest[k], strain = (len[k] - rest[k]) * inv;
    elastic<P>(law, strain, f, df);
    force[k] = truth[k] = linear[k] = stiffness[k] * f;
    if (P != 2 && at_multiplier && strain > 0 && carried[k] > 0) {
      double at = strain_of<P>(law, carried[k] / stiffness[k]);
      at = std::max(at, std::min(kLinearisationShare * strain, kReferenceStrain));
      double value;
      elastic<P>(law, at, value, df);
      linear[k] = stiffness[k] * (value + df * (strain - at));
    }
    elastic_slope[k] = slope[k] = stiffness[k] * df * inv;
  }
}

void elastic_forces(SpringSet& s, const Law& law, bool at_multiplier) {
  switch (power_class(law.exponent)) {
    case 2: return axial_forces<2>(s, law, at_multiplier);
    case 3: return axial_forces<3>(s, law, at_multiplier);
    case 4: return axial_forces<4>(s, law, at_multiplier);
    case 6: return axial_forces<6>(s, law, at_multiplier);
    default: return axial_forces<0>(s, law, at_multiplier);
  }
}

bool slack(const SpringSet& s, const Law& law, int k) {
  return s.damping[k] == 0 || (law.tension_only && s.length[k] <= s.rest[k]);
}

// Axial damping at the rate rate_of(k) [1/s], whose derivative by the length is 1/(b l).
template <class Rate>
void add_axial_damping(SpringSet& s, const Law& law, double step_weight, double share, Rate rate_of) {
  for (int k = 0; k < s.count; ++k) {
    if (slack(s, law, k)) continue;
    double f, df;
    damping(law, rate_of(k), f, df);
    s.force[k] += share * s.damping[k] * f;
    s.slope[k] += s.damping[k] * df / (step_weight * s.rest[k]);
  }
}

void blocks_and_vectors(SpringSet& s) {
  const int m = s.count;
  const double *nx = s.direction[0], *ny = s.direction[1], *nz = s.direction[2];
  const double *len = s.length.data(), *rest = s.rest.data(), *slope = s.slope.data();
  const double *carried = s.carried.data(), *force = s.force.data();
  double *xx = s.block[0], *xy = s.block[1], *xz = s.block[2];
  double *yy = s.block[3], *yz = s.block[4], *zz = s.block[5];
  double *fx = s.vector[0], *fy = s.vector[1], *fz = s.vector[2];
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    double least = kDegenerateLength * rest[k];
    double g = carried[k] / (len[k] > least ? len[k] : least), a = slope[k] - g;
    double ax = a * nx[k], ay = a * ny[k], az = a * nz[k];
    xx[k] = ax * nx[k] + g, xy[k] = ax * ny[k], xz[k] = ax * nz[k];
    yy[k] = ay * ny[k] + g, yz[k] = ay * nz[k], zz[k] = az * nz[k] + g;
    fx[k] = force[k] * nx[k], fy[k] = force[k] * ny[k], fz[k] = force[k] * nz[k];
  }
}

// C |w|^(q-1) w with w = (v_j - v_i)/l (equation 4 as printed), added to block and vector.
template <class Velocity>
void add_whole_damping(SpringSet& s, const Law& law, double step_weight, double share, Velocity velocity) {
  for (int k = 0; k < s.count; ++k) {
    if (slack(s, law, k)) continue;
    Vec3 w = (1 / s.rest[k]) * (velocity(k + s.reach) - velocity(k));
    double speed = norm(w), f, df;
    damping(law, speed, f, df);
    Vec3 along = unit_or(w, Vec3{0, 0, 1});
    double cross_slope = speed > 0 ? f / speed : df;
    Sym3 b = (s.damping[k] / (step_weight * s.rest[k])) *
             (cross_slope * across(along) + df * outer(along));
    Vec3 force = (share * s.damping[k] * f) * along;
    const double add[6] = {b.xx, b.xy, b.xz, b.yy, b.yz, b.zz};
    for (int c = 0; c < 6; ++c) s.block[c][k] += add[c];
    s.vector[0][k] += force.x, s.vector[1][k] += force.y, s.vector[2][k] += force.z;
  }
}

SpringScale scale_of(const SpringSet& s) {
  SpringScale scale;
  for (int k = 0; k < s.count; ++k) {
    scale.force = std::max(scale.force, std::fabs(s.force[k]));
    scale.stiffness = std::max(scale.stiffness, s.slope[k]);
  }
  return scale;
}

void take_true_multipliers(SpringSet& s) {
  for (int k = 0; k < s.count; ++k) s.carried[k] = std::max(0.0, s.force[k]), s.elastic[k] = s.linear[k];
}

bool damped(const SpringSet& s) {
  for (double c : s.damping)
    if (c != 0) return true;
  return false;
}

}  // namespace

SpringScale evaluate(SpringSet& s, const Law& law, const Field& x, const Field& xh, double b,
                     bool exact) {
  measure(s, x);
  elastic_forces(s, law, !exact);
  bool damp = damped(s);
  if (damp && !law.whole_velocity)
    add_axial_damping(s, law, b, 1, [&](int k) { return (s.length[k] - s.history[k]) / (b * s.rest[k]); });
  if (exact) take_true_multipliers(s);
  blocks_and_vectors(s);
  if (damp && law.whole_velocity)
    add_whole_damping(s, law, b, 1, [&](int i) { return (1 / b) * (x.at(i) - xh.at(i)); });
  return scale_of(s);
}

SpringScale evaluate_at(SpringSet& s, const Law& law, const Field& x, const Field& v, double dt,
                        double damping_share) {
  measure(s, x);
  elastic_forces(s, law, false);
  bool damp = damped(s);
  auto rate = [&](int k) {
    Vec3 n{s.direction[0][k], s.direction[1][k], s.direction[2][k]};
    return dot(n, v.at(k + s.reach) - v.at(k)) / s.rest[k];
  };
  if (damp && !law.whole_velocity) add_axial_damping(s, law, dt, damping_share, rate);
  take_true_multipliers(s);
  blocks_and_vectors(s);
  if (damp && law.whole_velocity) add_whole_damping(s, law, dt, damping_share, [&](int i) { return v.at(i); });
  return scale_of(s);
}

void scatter(const SpringSet& s, Field& residual, Band* matrix) {
  const int m = s.count, reach = s.reach;
  for (int c = 0; c < 3; ++c) {
    const double* f = s.vector[c];
    double* r = residual[c];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) r[k] -= f[k];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) r[k + reach] += f[k];
  }
  if (!matrix) return;
  constexpr int kFull[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
  for (int c = 0; c < 6; ++c) {
    const double* b = s.block[c];
    double* d = matrix->diagonal[c];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) d[k] += b[k];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) d[k + reach] += b[k];
  }
  Planes& off = matrix->below[reach - 1];
  for (int c = 0; c < 9; ++c) {
    const double* b = s.block[kFull[c]];
    double* e = off[c];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) e[k] -= b[k];
  }
}

void scatter_linearisation(const SpringSet& s, const Law& law, Field& right_hand) {
  if (is_linear(law)) return;
  for (int c = 0; c < 3; ++c) {
    const double* n = s.direction[c];
    double* r = right_hand[c];
    for (int k = 0; k < s.count; ++k) {
      double more = (s.linear[k] - s.true_elastic[k]) * n[k];
      r[k] -= more, r[k + s.reach] += more;
    }
  }
}

void carry(SpringSet& s, const Law&, const Field& dx) {
  const int m = s.count, reach = s.reach;
  const double *nx = s.direction[0], *ny = s.direction[1], *nz = s.direction[2];
  const double *ux = dx[0], *uy = dx[1], *uz = dx[2], *force = s.force.data(), *slope = s.slope.data();
  const double *linear = s.linear.data(), *elastic_slope = s.elastic_slope.data();
  const double* truth = s.true_elastic.data();
  double *carried = s.carried.data(), *elastic = s.elastic.data();
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    double elongation = nx[k] * (ux[k + reach] - ux[k]) + ny[k] * (uy[k + reach] - uy[k]) +
                        nz[k] * (uz[k + reach] - uz[k]);
    double t = force[k] - truth[k] + linear[k] + slope[k] * elongation;
    carried[k] = t > 0 ? t : 0;
    elastic[k] = linear[k] + elastic_slope[k] * elongation;
  }
}

double stored_energy(const SpringSet& s, const Law& law) {
  double sum = 0;
  for (int k = 0; k < s.count; ++k)
    sum += s.stiffness[k] * s.rest[k] * elastic_energy(law, s.length[k] / s.rest[k] - 1);
  return sum;
}

}  // namespace bt
