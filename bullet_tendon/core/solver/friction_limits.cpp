// Friction limits that go with the step, in the linear solution.
//
//   L_i = mu_i (N_0i - k_i (g_i + n_i.P_i u))   the limit of what slides, by the normal force after the step
//   u A u = -(r + sum_i P_i^T d_i (L_i - l_i))    l_i the limit that r has, d_i = z_i/|z_i|
//   (contact/contact.h)
//
// A is symmetric, and this coupling of friction with normal forces is not. By w = L - l it is
//
//   w - G w = w_0,   (G w)_i = mu_i k_i n_i.P_i A^-1 sum_j P_j^T d_j w_j,   w_0 of the step with w = 0,
//
// which needs nothing but solutions with the factors at hand, those of the bodies (solver/body_schur.cpp)
// included: by generalised conjugate residuals (Eisenstat, Elman and Schultz 1983). Were limits to follow
// forces from one iteration to the next, as many would be needed as friction is large.
#include "solver/friction_limits.h"

#include <cmath>
#include <utility>
#include <vector>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/linear_solve.h"

namespace bt {

namespace {

// How well limits are solved for beside the step [-], and by how many solutions at most
// (solver/friction_limits.cpp). Looser, or fewer: more iterations, each with a factorisation. More: solutions
// for what the next iteration changes.
constexpr int kLimitSolutions = 8;

using Numbers = dense::Numbers;

// Those about whose force two iterations agree, and w_0.
void find_sliding(const Group& group, std::vector<Row*>& rows, Numbers& changes) {
  for (Row* row : group.acting) {
    if (row->direct || !row->sliding || row->friction <= 0 || row->limit <= 0) continue;
    const double force = row->force_after(relative_position(group, *row, &Chain::step));
    if (!row->agrees(force)) continue;
    rows.push_back(row), changes.push_back(row->friction * force - row->limit);
  }
}

// What these changes of limits make of the step, to chain.solved (of opposite sign).
void answer(Group& group, const Options& o, const std::vector<Row*>& rows, const Numbers& w) {
  for (Chain* c : group.chains) c->column.zero();
  clear_loads(group);
  for (size_t i = 0; i < rows.size(); ++i) {
    const Row& row = *rows[i];
    const Vec3 force = (-w[i] / norm(row.raw)) * row.raw;
    pull_back(group.at(row.a).column, row.a, force);
    if (row.b.chain >= 0) pull_back(group.at(row.b).column, row.b, -1.0 * force);
    if (row.moves) load_body(group, row, force);
  }
  load_carried(group, &Chain::column);
  start_body_residual(group, 0);
  project_holds(group, &Chain::column);
  solve_again(group, o, &Chain::column, &Chain::solved);
  move_bodies(group, 1, &Chain::solved);
}

// q = w - G w.
void apply(Group& group, const Options& o, const std::vector<Row*>& rows, const Numbers& w, Numbers& q) {
  answer(group, o, rows, w);
  q = w;
  for (size_t i = 0; i < rows.size(); ++i) {
    const Row& row = *rows[i];
    q[i] -= row.friction * row.stiffness * dot(row.normal, relative_position(group, row, &Chain::solved));
  }
}

void add(Numbers& to, double share, const Numbers& what) {
  for (size_t i = 0; i < to.size(); ++i) to[i] += share * what[i];
}

// w, from the residual w_0 of w = 0.
Numbers solve(Group& group, const Options& o, const std::vector<Row*>& rows, Numbers residual) {
  const double enough = kLimitAccuracy * kLimitAccuracy * dense::dot(residual, residual);
  Numbers w(rows.size(), 0.0);
  std::vector<Numbers> ps, qs;  // directions, and what they make of the residual, of length one
  for (int k = 0; k < kLimitSolutions && dense::dot(residual, residual) > enough; ++k) {
    Numbers p = residual, q;
    apply(group, o, rows, p, q);
    for (size_t j = 0; j < ps.size(); ++j) {
      const double share = -dense::dot(q, qs[j]);
      add(q, share, qs[j]), add(p, share, ps[j]);
    }
    const double length = std::sqrt(dense::dot(q, q));
    if (!(length > 0)) break;
    for (double& v : p) v /= length;
    for (double& v : q) v /= length;
    const double share = dense::dot(residual, q);
    add(w, share, p), add(residual, -share, q);
    ps.push_back(std::move(p)), qs.push_back(std::move(q));
  }
  return w;
}

}  // namespace

void solve_limits(Group& group, const StepContext& context, double enough) {
  std::vector<Row*> rows;
  Numbers changes;
  find_sliding(group, rows, changes);
  if (!(largest_of(changes.data(), static_cast<int>(changes.size())) > enough)) return;
  const Numbers of_bodies = group.bodies.empty() ? Numbers{} : group.corner_side;
  const Numbers w = solve(group, context.options, rows, changes);
  answer(group, context.options, rows, w);
  combine(group, -1, &Chain::solved, 1, &Chain::step);
  if (!group.bodies.empty()) add(group.corner_side, 1, of_bodies);
  move_bodies(group, -1, &Chain::step);
}

}  // namespace bt
