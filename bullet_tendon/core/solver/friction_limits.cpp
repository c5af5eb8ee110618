// The coupling of friction limits with normal forces, in the linear solution.
//
//   L_i = mu_i (N_0i - k_i (g_i + n_i.P_i u))    limit of a sliding contact, from its normal force after the
//   step A u = -(r + sum_i P_i^T d_i (L_i - l_i))     l_i the limit in r, d_i = z_i/|z_i| (contact/contact.h)
//
// A is symmetric, but this coupling is not. With w = L - l it reads
//
//   w - G w = w_0,   (G w)_i = mu_i k_i n_i.P_i A^-1 sum_j P_j^T d_j w_j,   w_0 of the step with w = 0.
//
// Generalised conjugate residuals (Eisenstat, Elman and Schultz 1983) solve it. They need only solutions with
// the factors of A and of the bodies' Schur complement (solver/body_schur.cpp). Limits from the forces of the
// last iteration would need more iterations, increasingly with larger friction coefficients.
#include <cmath>
#include <utility>
#include <vector>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// Relative accuracy of w [-]. Looser: more iterations, each with a factorisation. Tighter: solutions for what
// the next iteration changes anyway.
constexpr double kLimitAccuracy = 0.03;

// Lists the sliding contacts, and w_0 [N].
void find_sliding(const Island& island, std::vector<Contact*>& contacts, Numbers& changes) {
  for (Contact* contact : island.acting) {
    if (contact->normal_force.direct || !contact->friction.sliding || contact->friction.coefficient <= 0 ||
        contact->friction.limit <= 0)
      continue;
    const double force = contact->force_after(relative_position(island, *contact, &Tendon::dx));
    contacts.push_back(contact);
    changes.push_back(contact->friction.coefficient * force - contact->friction.limit);
  }
}

// Computes the change of the step by the changes w of the limits, with opposite sign, in tendon.solved.
void answer(Island& island, const Options& o, const std::vector<Contact*>& contacts, const Numbers& w) {
  for (Tendon* c : island.tendons) c->column.zero();
  clear_loads(island);
  for (size_t i = 0; i < contacts.size(); ++i) {
    const Contact& contact = *contacts[i];
    const Vec3 force = (-w[i] / norm(contact.friction.raw)) * contact.friction.raw;
    exert(island, contact, force, &Tendon::column);
  }
  answer_forces(island, o, &Tendon::column, &Tendon::solved);
  move_bodies(island, 1, &Tendon::solved);
}

// q = w - G w.
void apply(Island& island, const Options& o, const std::vector<Contact*>& contacts, const Numbers& w,
           Numbers& q) {
  answer(island, o, contacts, w);
  q = w;
  for (size_t i = 0; i < contacts.size(); ++i) {
    const Contact& contact = *contacts[i];
    q[i] -= contact.friction.coefficient * contact.normal_force.stiffness *
            dot(contact.geometry.normal, relative_position(island, contact, &Tendon::solved));
  }
}

// Solves for w, starting at w = 0 with the residual w_0.
Numbers solve(Island& island, const Options& o, const std::vector<Contact*>& contacts, Numbers residual) {
  const double enough = kLimitAccuracy * kLimitAccuracy * dense::dot(residual, residual);
  Numbers w(contacts.size(), 0.0);
  std::vector<Numbers> ps, qs;  // directions p, and q = p - G p normalised
  for (int k = 0; k < kMostCorrections && dense::dot(residual, residual) > enough; ++k) {
    Numbers p = residual, q;
    apply(island, o, contacts, p, q);
    for (size_t j = 0; j < ps.size(); ++j) {
      const double share = -dense::dot(q, qs[j]);
      dense::add(q, share, qs[j]);
      dense::add(p, share, ps[j]);
    }
    const double length = std::sqrt(dense::dot(q, q));
    if (!(length > 0)) break;
    for (double& v : p) v /= length;
    for (double& v : q) v /= length;
    const double share = dense::dot(residual, q);
    dense::add(w, share, p);
    dense::add(residual, -share, q);
    ps.push_back(std::move(p));
    qs.push_back(std::move(q));
  }
  return w;
}

}  // namespace

void solve_limits(Island& island, const StepContext& context, double enough) {
  std::vector<Contact*> contacts;
  Numbers changes;
  find_sliding(island, contacts, changes);
  if (!(largest_of(changes.data(), static_cast<int>(changes.size())) > kLimitAccuracy * enough)) return;
  const Numbers of_bodies = island.bodies.indices.empty() ? Numbers{} : island.bodies.corner_side;
  const Numbers w = solve(island, context.options, contacts, changes);
  answer(island, context.options, contacts, w);
  combine(island, -1, &Tendon::solved, 1, &Tendon::dx);
  dense::add(island.bodies.corner_side, 1, of_bodies);
  move_bodies(island, -1, &Tendon::dx);
}

}  // namespace bt
