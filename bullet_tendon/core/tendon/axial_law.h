// The axial law of a spring, per strain (paper, equations 3 and 4).
//
//   s = (length - l) / l                    strain [-], l the rest length
//   f(s) = K sgn(s) |s|^p                   elastic force [N], for |s| <= e_t
//   f(s) = K sgn(s) (e_t^p + p e_t^(p-1) (|s| - e_t))   beyond the toe strain e_t, along the tangent
//   f(s) = 0 for s < 0                      where tension_only
//   d(r) = C sgn(r) |r|^q                   damping force [N], r = ds/dt [1/s]
//   d(r) = 0 for r < 0                      where lengthening_only
//
// Exponent 2 with toe strain e_t is the ligament law of Blankevoort 1991 with k = 2 e_t K.
#pragma once
#include <cmath>
#include <limits>
#include <type_traits>

#include "math/simd.h"

namespace bt {

struct Law {
  double exponent = 1;                                          // p >= 1
  double toe_strain = std::numeric_limits<double>::infinity();  // e_t > 0
  bool tension_only = false;
  double damping_exponent = 1;    // q >= 1
  bool whole_velocity = false;    // damping by the whole relative velocity, as printed in equation 4
  bool lengthening_only = false;  // damping only while the spring lengthens
};

// Strain at which the damping of a tension-only spring without a shorter toe is complete, and at which the
// contact stiffness of a slack tendon takes the tangent of the material [-]. A power law has no stiffness at
// rest, but a contact must be stiff before the load comes.
constexpr double kReferenceStrain = 0.01;

// s^p and its derivative p s^(p-1), for s >= 0. P is twice the exponent for the common exponents, which need
// no pow. P = 0 is for any other exponent.
template <int P>
inline void power(double s, double p, double& value, double& slope) {
  if constexpr (P == 2) {
    value = s;
    slope = 1;
  } else if constexpr (P == 3) {
    double root = std::sqrt(s);
    value = s * root;
    slope = 1.5 * root;
  } else if constexpr (P == 4) {
    value = s * s;
    slope = 2 * s;
  } else if constexpr (P == 6) {
    value = s * s * s;
    slope = 3 * s * s;
  } else {
    value = std::pow(s, p);
    slope = s > 0 ? p * value / s : 0.0;
  }
}

// Calls call(P), P an integral_constant, with the P of the templates here for this exponent.
template <class Call>
BT_WITHIN inline void by_exponent(double exponent, Call call) {
  if (exponent == 1) return call(std::integral_constant<int, 2>{});
  if (exponent == 1.5) return call(std::integral_constant<int, 3>{});
  if (exponent == 2) return call(std::integral_constant<int, 4>{});
  if (exponent == 3) return call(std::integral_constant<int, 6>{});
  call(std::integral_constant<int, 0>{});
}

// Elastic force per unit K, and its derivative by the strain.
template <int P>
inline void elastic(const Law& law, double s, double& force, double& slope) {
  double a = std::fabs(s), inside = a < law.toe_strain ? a : law.toe_strain;
  power<P>(inside, law.exponent, force, slope);
  force += slope * (a - inside);  // 0 within the toe
  double on = law.tension_only && s < 0 ? 0.0 : 1.0;
  force *= s < 0 ? -on : on;
  slope *= on;
}

inline void elastic_any(const Law& law, double s, double& force, double& slope) {
  by_exponent(law.exponent, [&](auto P) BT_WITHIN { elastic<P>(law, s, force, slope); });
}

// The inverse of `elastic` in tension: the strain at which the elastic force per unit K is t > 0. An error
// of it only costs iterations.
template <int P>
inline double strain_of(const Law& law, double t) {
  double s;
  if constexpr (P == 2)
    s = t;
  else if constexpr (P == 3)
    s = std::cbrt(t * t);
  else if constexpr (P == 4)
    s = std::sqrt(t);
  else if constexpr (P == 6)
    s = std::cbrt(t);
  else
    s = std::pow(t, 1 / law.exponent);
  if (s <= law.toe_strain) return s;
  double value, slope;
  power<P>(law.toe_strain, law.exponent, value, slope);
  return law.toe_strain + (t - value) / slope;
}

inline bool is_linear(const Law& law) { return law.exponent == 1 && !law.tension_only; }

// Elastic energy per unit K and rest length: the integral of the force over the strain.
template <int P>
inline double elastic_energy(const Law& law, double s) {
  double a = std::fabs(s), p = law.exponent, inside = a < law.toe_strain ? a : law.toe_strain;
  double value, slope;
  power<P>(inside, p, value, slope);
  double beyond = a - inside,
         energy = inside * value / (p + 1) + value * beyond + 0.5 * slope * beyond * beyond;
  return law.tension_only && s < 0 ? 0.0 : energy;
}

inline double elastic_energy_any(const Law& law, double s) {
  double energy;
  by_exponent(law.exponent, [&](auto P) BT_WITHIN { energy = elastic_energy<P>(law, s); });
  return energy;
}

// Damping force per unit C, and its derivative by the strain rate.
inline void damping(const Law& law, double rate, double& force, double& slope) {
  if (law.lengthening_only && rate < 0) {
    force = slope = 0;
    return;
  }
  if (law.damping_exponent == 1) {
    force = rate;
    slope = 1;
    return;
  }
  double value;
  power<0>(std::fabs(rate), law.damping_exponent, value, slope);
  force = rate < 0 ? -value : value;
}

// Share of the damping that acts on a spring of this strain at the start of the step [-]: 1, except for
// tension-only springs. Their damping rises linearly up to the toe strain or the reference strain, because
// damping that starts at strain 0 would make the force jump.
inline double damping_share(const Law& law, double strain) {
  if (!law.tension_only) return 1;
  const double full = law.toe_strain < kReferenceStrain ? law.toe_strain : kReferenceStrain;
  return strain <= 0 ? 0 : strain < full ? strain / full : 1;
}

// Integral of the damping force per unit C over the strain rate.
inline double dissipation(const Law& law, double rate) {
  double force, slope;
  damping(law, rate, force, slope);
  return force * rate / (law.damping_exponent + 1);
}

}  // namespace bt
