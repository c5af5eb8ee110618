// What time and load do to the tissue of tendons and ligaments.
//
// The elastic tension T_e may relax in time (quasi-linear viscoelasticity, Fung 1993),
//
//   T_v(t) = int G(t - u) dT_e/du du,     G(t) = g_0 + sum g_i exp(-t/t_i),   g_0 = 1 - sum g_i.
//
// Where T_e changes linearly within a substep of h, the parts m_i of T_v = g_0 T_e + sum m_i change exactly
// by
//
//   m_i <- e_i m_i + g_i a_i (T_e - T_e0),   e_i = exp(-h/t_i),   a_i = (1 - e_i) t_i/h.
//
// So T_v = share T_e + recalled is a function of the length alone within a substep, with a potential:
//
//   share = g_0 + sum g_i a_i,     recalled = sum (e_i m_i - g_i a_i T_e0).
//
// A memory that begins takes the present tension to have come at once, m_i = g_i T_e. What ends a substep
// beyond its largest tension or strain is ruptured.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace bt {

struct Tissue {
  std::vector<double> weights, times;  // g_i [-], t_i [s]
  double most_force = 0;               // at rupture [N]; 0: none
  double most_strain = 0;              // at rupture [-]; 0: none

  bool relaxes() const { return !weights.empty(); }
  bool can_rupture() const { return most_force > 0 || most_strain > 0; }
  // Force or strain over the largest one; above 1 it ruptures [-].
  double excess(double force, double strain) const {
    const double by_force = most_force > 0 ? force / most_force : 0;
    return std::max(by_force, most_strain > 0 ? strain / most_strain : 0);
  }
};

// The coefficients of a substep. A memory is a list of the parts m_i [N].
class Relaxation {
 public:
  // A substep of h [s] >= 0.
  void begin(const Tissue& tissue, double h) {
    decays_.resize(tissue.weights.size());
    gains_.resize(tissue.weights.size());
    share_ = 1;
    for (size_t i = 0; i < decays_.size(); ++i) {
      const double ratio = h / tissue.times[i], g = tissue.weights[i];
      decays_[i] = std::exp(-ratio);
      gains_[i] = ratio > 0 ? -g * std::expm1(-ratio) / ratio : g;
      share_ += gains_[i] - g;
    }
  }
  double share() const { return share_; }  // [-]
  // From the memory and T_e at the start of the substep [N].
  double recalled(const double* memory, double elastic) const {
    double sum = 0;
    for (size_t i = 0; i < decays_.size(); ++i) sum += decays_[i] * memory[i] - gains_[i] * elastic;
    return sum;
  }
  // Brings the memory to the end of the substep, in which T_e changed by `change` [N].
  void advance(double* memory, double change) const {
    for (size_t i = 0; i < decays_.size(); ++i) memory[i] = decays_[i] * memory[i] + gains_[i] * change;
  }

 private:
  double share_ = 1;
  std::vector<double> decays_, gains_;  // e_i, g_i a_i
};

}  // namespace bt
