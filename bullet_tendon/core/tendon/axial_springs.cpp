#include "tendon/axial_springs.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "math/rounding.h"

namespace bt {

void SpringSet::resize(int reach_, int particles) {
  reach = reach_;
  count = particles > reach ? particles - reach : 0;
  for (auto* v : {&rest,          &inverse_rest,  &stiffness,      &damping,       &lambda,        &elastic,
                  &lighter,       &start,         &history,        &length,        &force,         &slope,
                  &linear,        &true_elastic,  &linear_elastic, &elastic_slope, &damping_slope, &braking,
                  &braking_slope, &stiffness_now, &recalled})
    v->assign(count, 0.0);
  direction.resize(3, count);
  block.resize(6, count);
  vector.resize(3, count);
}

void take_springs(SpringSet& s, const SpringSet& from) {
  if (s.count != from.count || s.reach != from.reach) s.resize(from.reach, from.count + from.reach);
  s.rest = from.rest;
  s.inverse_rest = from.inverse_rest;
  s.stiffness = from.stiffness;
  s.damping = from.damping;
  s.damped = from.damped;
  s.lighter = from.lighter;
  s.share = from.share;
  s.recalled = from.recalled;
  s.unrelaxed = from.unrelaxed;
  s.memory = from.memory;
}

namespace {

// The differences of neighbours' positions are exact.
template <bool Displaced>
BT_WITHIN inline void measure_at(SpringSet& s, const Field& x, const Field& displacement) {
  const int m = s.count, reach = s.reach;
  double *nx = s.direction[0], *ny = s.direction[1], *nz = s.direction[2], *len = s.length.data();
  const double *px = x[0], *py = x[1], *pz = x[2], *rest = s.rest.data();
  const double *ux = displacement[0], *uy = displacement[1], *uz = displacement[2];
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    double dx = px[k + reach] - px[k], dy = py[k + reach] - py[k], dz = pz[k + reach] - pz[k];
    if (Displaced) {
      dx += ux[k + reach] - ux[k];
      dy += uy[k + reach] - uy[k];
      dz += uz[k + reach] - uz[k];
    }
    double length = std::sqrt(dx * dx + dy * dy + dz * dz);
    bool degenerate = length < kRoundingShare * rest[k];  // no direction but noise
    double inv = degenerate ? 0.0 : 1 / length;
    len[k] = length;
    nx[k] = dx * inv;
    ny[k] = dy * inv;
    nz[k] = degenerate ? 1.0 : dz * inv;
  }
}

}  // namespace

BT_VECTOR void measure(SpringSet& s, const Field& x) { measure_at<false>(s, x, x); }

namespace {

template <int P>
BT_WITHIN inline void elastic_forces(SpringSet& s, const Law& law) {
  const double *len = s.length.data(), *rest = s.rest.data(), *stiffness = s.stiffness.data();
  const double* inverse = s.inverse_rest.data();
  double *force = s.force.data(), *truth = s.true_elastic.data(), *slope = s.elastic_slope.data();
  const double share = s.share;
#pragma GCC ivdep
  for (int k = 0; k < s.count; ++k) {
    double f, df, inv = inverse[k], K = share * stiffness[k];
    elastic<P>(law, (len[k] - rest[k]) * inv, f, df);
    force[k] = truth[k] = K * f;
    slope[k] = K * df * inv;
  }
}

// Linearises the elastic law at the strains of the multipliers (tendon/axial_springs.h).
template <int P>
BT_WITHIN inline void elastic_linearisation(SpringSet& s, const Law& law, bool mixed, double floor_force) {
  const double *len = s.length.data(), *rest = s.rest.data(), *stiffness = s.stiffness.data();
  const double *inverse = s.inverse_rest.data(), *elastic_part = s.elastic.data(),
               *truth = s.true_elastic.data(), *force = s.force.data(), *braking = s.braking.data(),
               *braking_slope = s.braking_slope.data();
  double *carried = s.lambda.data(), *linear = s.linear.data(), *elastic_slope = s.elastic_slope.data();
  double *linear_elastic = s.linear_elastic.data(), *damping_slope = s.damping_slope.data();
  const double least = law.tension_only ? 0 : -std::numeric_limits<double>::infinity(), share = s.share;
#pragma GCC ivdep
  for (int k = 0; k < s.count; ++k) {
    const double inv = inverse[k], strain = (len[k] - rest[k]) * inv, multiplier = elastic_part[k];
    const double K = share * stiffness[k];  // 0: ruptured
    const double tight = mixed && multiplier > 0 ? multiplier : floor_force;
    const double at = strain_of<P>(law, K > 0 ? tight / K : 0);
    double value, df;
    elastic<P>(law, at, value, df);
    const double slope = K * df * inv, now = elastic_slope[k];
    const bool limited = (force[k] == 0) & (truth[k] > 0);
    const double raised = strain >= least && slope > now && !limited ? slope : now;
    // What is predicted not to pull goes to the floor by the chord. By the tangent of a toe, each iteration
    // would halve its strain.
    const bool slackens = mixed & (multiplier <= 0) & (strain > at) & (truth[k] > K * value) & !limited;
    const double chord = slackens ? (truth[k] - K * value) / (strain - at) * inv : raised;
    const bool there = mixed & (multiplier > 0) & (carried[k] > least);
    const double line = K * (value + df * (strain - at));
    linear_elastic[k] = there ? line : truth[k];
    linear[k] = there ? line + braking[k] : force[k];
    elastic_slope[k] = there ? slope : chord;
    damping_slope[k] = there ? braking_slope[k] : damping_slope[k];
    // Where the true force pulls, particles that yield across it as if it did not would stretch the spring.
    carried[k] = !there & (force[k] > carried[k]) ? force[k] : carried[k];
  }
}

// Whether springs have more axial force than that of share K f.
bool has_braking(const SpringSet& s, const Law& law) {
  return (s.damped && !law.whole_velocity) || !s.memory.empty();
}

// Adds what relaxation recalls, and axial damping at the strain rate rate_of(k) [1/s], whose derivative by
// the length is 1/(b l). The total force of a tension-only spring is never negative.
template <class Rate>
void add_braking(SpringSet& s, const Law& law, const double* before, double b, double share, Rate rate_of) {
  const bool damped = s.damped && !law.whole_velocity;
  for (int k = 0; k < s.count; ++k) {
    double c = 0, f = 0, df = 0;
    if (damped) {
      c = s.damping[k] * damping_share(law, before[k] / s.rest[k] - 1);
      damping(law, rate_of(k), f, df);
    }
    s.braking[k] = share * c * f + s.recalled[k];
    s.force[k] += s.braking[k];
    s.damping_slope[k] = s.braking_slope[k] = c * df / (b * s.rest[k]);
    if (law.tension_only && s.force[k] < 0) {
      s.force[k] = 0;
      s.damping_slope[k] = 0;
      s.elastic_slope[k] = 0;
    }
  }
}

BT_VECTOR void vectors(SpringSet& s) {
  for (int c = 0; c < 3; ++c) {
    const double *n = s.direction[c], *force = s.force.data();
    double* f = s.vector[c];
#pragma GCC ivdep
    for (int k = 0; k < s.count; ++k) f[k] = force[k] * n[k];
  }
}

// inertia: 1/(2 k b^2) [1/s^2], see below; 0 leaves out the transverse part of compressed springs; infinity
// never limits it.
//
// A compressed spring of a particle with up to k springs may subtract 1/(2 k) of the inertia m/b^2 of the
// lighter one of its particles: (u_i - u_j)^2 <= 2 (u_i^2 + u_j^2). The particles at the ends have fewer
// springs, so that equality would need u = 0 there, and u_j = -u_i elsewhere. Therefore the matrix is
// definite for any compression. Without shear springs k is 2, and a tendon that has buckled in every segment
// carries just this: with less, the descent to it would converge slowly.
BT_VECTOR void blocks(SpringSet& s, double inertia) {
  const int m = s.count;
  const double *nx = s.direction[0], *ny = s.direction[1], *nz = s.direction[2];
  const double *len = s.length.data(), *rest = s.rest.data(), *carried = s.lambda.data();
  const double *elastic_slope = s.elastic_slope.data(), *damping_slope = s.damping_slope.data();
  double *xx = s.block[0], *xy = s.block[1], *xz = s.block[2];
  double *yy = s.block[3], *yz = s.block[4], *zz = s.block[5], *slope = s.slope.data();
  const double* lighter = s.lighter.data();
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    double least = kRoundingShare * rest[k];
    double g = carried[k] / (len[k] > least ? len[k] : least), lowest = -inertia * lighter[k];
    g = g > lowest ? g : lowest;
    double f = elastic_slope[k] + damping_slope[k];
    double a = f - g, ax = a * nx[k], ay = a * ny[k], az = a * nz[k];
    slope[k] = f;
    xx[k] = ax * nx[k] + g;
    xy[k] = ax * ny[k];
    xz[k] = ax * nz[k];
    yy[k] = ay * ny[k] + g;
    yz[k] = ay * nz[k];
    zz[k] = az * nz[k] + g;
  }
}

// Adds the damping C |w|^(q-1) w with w = (v_j - v_i)/l (equation 4 as printed): its block if `block`, else
// its force vector.
template <class Velocity>
void add_whole_damping(SpringSet& s, const Law& law, double b, double share, bool block, Velocity velocity) {
  for (int k = 0; k < s.count; ++k) {
    const double c = s.damping[k] * damping_share(law, s.length[k] / s.rest[k] - 1);
    Vec3 w = (1 / s.rest[k]) * (velocity(k + s.reach) - velocity(k));
    double speed = norm(w), f, df;
    damping(law, speed, f, df);
    Vec3 along = unit_or(w, Vec3{0, 0, 1}), force = (share * c * f) * along;
    if (!block) {
      s.vector[0][k] += force.x;
      s.vector[1][k] += force.y;
      s.vector[2][k] += force.z;
      continue;
    }
    double cross_slope = speed > 0 ? f / speed : df;
    Sym3 d = (c / (b * s.rest[k])) * (cross_slope * across(along) + df * outer(along));
    set(s.block, k, symmetric_at(s.block, k) + d);
  }
}

void take_true_multipliers(SpringSet& s) {
  for (int k = 0; k < s.count; ++k) {
    s.lambda[k] = s.force[k];
    s.elastic[k] = s.true_elastic[k];
  }
}

}  // namespace

BT_VECTOR void find_forces(SpringSet& s, const Law& law, const Motion& motion) {
  const double b = motion.h_eff;
  measure_at<true>(s, motion.x, motion.displacement);
  by_exponent(law.exponent, [&](auto P) BT_WITHIN { elastic_forces<P>(s, law); });
  if (has_braking(s, law))
    add_braking(s, law, s.start.data(), b, 1,
                [&](int k) { return (s.length[k] - s.history[k]) / (b * s.rest[k]); });
}

double evaluate(SpringSet& s, const Law& law, const Motion& motion) {
  find_forces(s, law, motion);
  vectors(s);
  if (s.damped && law.whole_velocity)
    add_whole_damping(s, law, motion.h_eff, 1, false, [&](int i) { return motion.velocity(i); });
  return largest_of(s.force.data(), s.count);
}

BT_VECTOR void linearise(SpringSet& s, const Law& law, Linearisation how, double floor_force,
                         const Motion& motion, int most_springs) {
  const double b = motion.h_eff;
  if (how == Linearisation::position) take_true_multipliers(s);
  if (!is_linear(law)) {
    const bool mixed = how == Linearisation::multiplier;
    by_exponent(law.exponent,
                [&](auto P) BT_WITHIN { elastic_linearisation<P>(s, law, mixed, floor_force); });
  }
  blocks(s, most_springs ? 1 / (2 * most_springs * b * b) : std::numeric_limits<double>::infinity());
  if (s.damped && law.whole_velocity)
    add_whole_damping(s, law, b, 1, true, [&](int i) { return motion.velocity(i); });
}

void evaluate_at(SpringSet& s, const Law& law, const Field& x, const Field& v, double dt,
                 double damping_share) {
  measure(s, x);
  by_exponent(law.exponent, [&](auto P) { elastic_forces<P>(s, law); });
  auto rate = [&](int k) {
    Vec3 n{s.direction[0][k], s.direction[1][k], s.direction[2][k]};
    return dot(n, v.at(k + s.reach) - v.at(k)) / s.rest[k];
  };
  auto velocity = [&](int i) { return v.at(i); };
  const bool whole = s.damped && law.whole_velocity;
  if (has_braking(s, law)) add_braking(s, law, s.length.data(), dt, damping_share, rate);
  take_true_multipliers(s);
  vectors(s);
  blocks(s, 0);
  if (whole) add_whole_damping(s, law, dt, damping_share, false, velocity);
  if (whole) add_whole_damping(s, law, dt, damping_share, true, velocity);
}

BT_VECTOR void carry(SpringSet& s, const Law& law, const Field& dx) {
  const int m = s.count, reach = s.reach;
  const double *nx = s.direction[0], *ny = s.direction[1], *nz = s.direction[2];
  const double *ux = dx[0], *uy = dx[1], *uz = dx[2], *force = s.force.data(), *slope = s.slope.data();
  const double *linear = s.linear.data(), *elastic_slope = s.elastic_slope.data();
  const double *truth = s.true_elastic.data(), *linear_elastic = s.linear_elastic.data();
  double *carried = s.lambda.data(), *elastic = s.elastic.data();
  const bool same = is_linear(law);  // and `force` is then its own linearisation
  const double least = law.tension_only ? 0 : -std::numeric_limits<double>::infinity();
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    double elongation =
        nx[k] * (ux[k + reach] - ux[k]) + ny[k] * (uy[k + reach] - uy[k]) + nz[k] * (uz[k + reach] - uz[k]);
    const double t = (same ? force[k] : linear[k]) + slope[k] * elongation;
    carried[k] = t > least ? t : least;
    elastic[k] = (same ? truth[k] : linear_elastic[k]) + elastic_slope[k] * elongation;
  }
}

BT_VECTOR double find_curvature_forces(SpringSet& s, const Field& dx) {
  const int m = s.count, reach = s.reach;
  const double *nx = s.direction[0], *ny = s.direction[1], *nz = s.direction[2];
  const double *ux = dx[0], *uy = dx[1], *uz = dx[2], *slope = s.slope.data();
  const double *len = s.length.data(), *rest = s.rest.data();
  double* force = s.force.data();
#pragma GCC ivdep
  for (int k = 0; k < m; ++k) {
    const double ex = ux[k + reach] - ux[k], ey = uy[k + reach] - uy[k], ez = uz[k + reach] - uz[k];
    const double along = nx[k] * ex + ny[k] * ey + nz[k] * ez;
    const double px = ex - along * nx[k], py = ey - along * ny[k], pz = ez - along * nz[k];
    const double least = kRoundingShare * rest[k];
    force[k] = 0.5 * slope[k] * (px * px + py * py + pz * pz) / (len[k] > least ? len[k] : least);
  }
  vectors(s);
  return largest_of(force, m);
}

void begin_relaxation(SpringSet& s, const Relaxation& relaxation) {
  const size_t terms = s.memory.size() / std::max(1, s.count);
  s.share = relaxation.share();
  for (int k = 0; k < s.count; ++k) s.recalled[k] = relaxation.recalled(&s.memory[k * terms], s.unrelaxed[k]);
}

void end_relaxation(SpringSet& s, const Law& law, const Tissue& tissue, const Relaxation& relaxation,
                    const Field& x, bool afresh) {
  const size_t terms = tissue.weights.size();
  s.unrelaxed.resize(s.count);
  s.memory.resize(s.count * terms);
  measure(s, x);
  for (int k = 0; k < s.count; ++k) {
    double f, slope, *memory = &s.memory[k * terms];
    elastic_any(law, s.length[k] * s.inverse_rest[k] - 1, f, slope);
    const double now = s.stiffness[k] * f;
    if (!afresh) relaxation.advance(memory, now - s.unrelaxed[k]);
    for (size_t i = 0; afresh && i < terms; ++i) memory[i] = tissue.weights[i] * now;
    s.unrelaxed[k] = now;
  }
}

double maxwell_energy(const SpringSet& s, const Law& law, const Tissue& tissue, int k, double length) {
  const size_t terms = tissue.weights.size();
  const double strain = length * s.inverse_rest[k] - 1, K = s.stiffness[k];
  if (K == 0) return 0;
  double f, slope, share = 1, each = 0;
  elastic_any(law, strain, f, slope);
  for (size_t i = 0; i < terms; ++i) {
    const double g = tissue.weights[i], part = s.memory[k * terms + i] + g * (K * f - s.unrelaxed[k]);
    each += g * elastic_energy_any(law, strain_of<0>(law, std::fabs(part) / (g * K)));
    share -= g;
  }
  return K * s.rest[k] * (share * elastic_energy_any(law, strain) + each);
}

BT_VECTOR double largest_stiffness(SpringSet& s, const Law& law, double b) {
  const double *inverse = s.inverse_rest.data(), *slope = s.elastic_slope.data(), *damping = s.damping.data();
  const double *damping_slope = s.damping_slope.data(), *force = s.force.data();
  double* now = s.stiffness_now.data();
  const bool whole = law.whole_velocity;
#pragma GCC ivdep
  for (int k = 0; k < s.count; ++k) {
    const double inv = inverse[k], braking = whole ? damping[k] / b * inv * inv : damping_slope[k];
    now[k] = slope[k] + braking + std::fabs(force[k]) * inv;
  }
  return largest_of(now, s.count);
}

namespace {

// Elastic energies of springs, or of those that relax the potentials within the substep, at length_of(k) [J].
template <int P, class Length>
BT_WITHIN inline void stored_energies(const SpringSet& s, const Law& law, Length length_of, double* out) {
  const double *rest = s.rest.data(), *inverse = s.inverse_rest.data(), *stiffness = s.stiffness.data(),
               *recalled = s.recalled.data(), share = s.share;
#pragma GCC ivdep
  for (int k = 0; k < s.count; ++k) {
    const double length = length_of(k), strain = (length - rest[k]) * inverse[k];
    out[k] = share * stiffness[k] * rest[k] * elastic_energy<P>(law, strain) + recalled[k] * length;
  }
}

template <class Length>
BT_WITHIN inline double sum_of_energies(const SpringSet& s, const Law& law, Length length_of) {
  static thread_local std::vector<double> each;
  each.resize(s.count);
  double* out = each.data();
  by_exponent(law.exponent, [&](auto P) BT_WITHIN { stored_energies<P>(s, law, length_of, out); });
  return std::accumulate(each.begin(), each.end(), 0.0);
}

}  // namespace

BT_VECTOR double stored_energy(const SpringSet& s, const Law& law) {
  const double* length = s.length.data();
  return sum_of_energies(s, law, [=](int k) BT_WITHIN { return length[k]; });
}

BT_VECTOR double stored_energy(const SpringSet& s, const Law& law, const Field& at) {
  const double *x = at[0], *y = at[1], *z = at[2];
  const int reach = s.reach;
  return sum_of_energies(s, law, [=](int k) BT_WITHIN {
    const double dx = x[k + reach] - x[k], dy = y[k + reach] - y[k], dz = z[k + reach] - z[k];
    return std::sqrt(dx * dx + dy * dy + dz * dz);
  });
}

namespace {

// Residuals and matrices of the particles from those of the springs.

// r -= f(k) at the first particle of every spring, r += f(k) at the second.
template <class Force>
BT_WITHIN inline void scatter(double* r, int m, int reach, Force f) {
  const int lo = std::min(m, reach);
  for (int i = 0; i < lo; ++i) r[i] -= f(i);
#pragma GCC ivdep
  for (int i = lo; i < m; ++i) r[i] = (r[i] - f(i)) + f(i - reach);
  for (int i = std::max(m, reach); i < m + reach; ++i) r[i] += f(i - reach);
}

// d = own w + the diagonal blocks b of structure springs, in one loop: the processor stalls where it reads
// values, shifted by a place, that it has just stored.
BT_WITHIN inline void start_diagonal(double* d, const double* w, double own, const double* b, int n) {
  d[0] = own * w[0] + b[0];
  d[n - 1] = own * w[n - 1] + b[n - 2];
#pragma GCC ivdep
  for (int i = 1; i < n - 1; ++i) d[i] = own * w[i] + b[i] + b[i - 1];
}

}  // namespace

BT_VECTOR void scatter_forces(const SpringSet& s, Field& residual) {
  for (int c = 0; c < 3; ++c) {
    const double* f = s.vector[c];
    scatter(residual[c], s.count, s.reach, [=](int k) BT_WITHIN { return f[k]; });
  }
}

BT_VECTOR void start_matrix(const SpringSet& s, const std::vector<double>& mass, double inverse,
                            Band& matrix) {
  for (int c = 0; c < 6; ++c) {
    const double own = c == 0 || c == 3 || c == 5 ? inverse : 0;
    start_diagonal(matrix.diagonal[c], mass.data(), own, s.block[c], matrix.n);
  }
  for (int c = 0; c < 9; ++c) {
    const double* b = s.block[kFull[c]];
    double* e = matrix.below[0][c];
#pragma GCC ivdep
    for (int k = 0; k < s.count; ++k) e[k] = -b[k];
  }
  if (matrix.half == 2) matrix.below[1].zero();
}

BT_VECTOR void scatter_blocks(const SpringSet& s, Band& matrix) {
  const int m = s.count, reach = s.reach;
  for (int c = 0; c < 6; ++c) {
    const double* b = s.block[c];
    double* d = matrix.diagonal[c];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) d[k] += b[k];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) d[k + reach] += b[k];
  }
  Planes& off = matrix.below[reach - 1];
  for (int c = 0; c < 9; ++c) {
    const double* b = s.block[kFull[c]];
    double* e = off[c];
#pragma GCC ivdep
    for (int k = 0; k < m; ++k) e[k] -= b[k];
  }
}

BT_VECTOR void scatter_linearisation(const SpringSet& s, const Law& law, Field& right_hand) {
  if (is_linear(law)) return;
  for (int c = 0; c < 3; ++c) {
    const double *n = s.direction[c], *linear = s.linear.data(), *force = s.force.data();
    scatter(right_hand[c], s.count, s.reach, [=](int k) BT_WITHIN { return (linear[k] - force[k]) * n[k]; });
  }
}

}  // namespace bt
