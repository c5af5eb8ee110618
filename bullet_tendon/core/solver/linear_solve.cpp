// Solution of A step = -residual for the tendons of an island and the unknowns of bodies.
//
// The matrix of one tendon is banded. That of tendons in contact is sparse. Both are factorised. The paper's
// solver, an option, is conjugate gradients preconditioned by the inverse diagonal blocks. Bodies are a
// border of the matrix (solver/body_schur.cpp).
#include <algorithm>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// The sparse matrix of tendons in contact: their bands and the blocks of coupling contacts.

int block_at(const Island& island, int tendon, int i) { return island.matrix.offset[tendon] + i; }

// Numbers the blocks of the tendons. Returns the number of blocks.
int number_blocks(Island& island) {
  island.matrix.offset.assign(island.slots->size(), -1);
  int count = 0;
  for (size_t k = 0; k < island.tendons.size(); ++k) {
    island.matrix.offset[island.numbers[k]] = count;
    count += island.tendons[k]->n();
  }
  return count;
}

// Finds the sparsity pattern. It includes all contacts that were active at any time in this solution, so that
// it changes rarely.
void find_pattern(Island& island) {
  bool same = island.matrix.factor.blocks() > 0 && island.matrix.patterned;
  for (Contact* contact : island.acting)
    if (contact->b.tendon >= 0 && !contact->joins) {
      contact->joins = true;
      same = false;
    }
  if (same) return;
  island.matrix.patterned = true;
  island.matrix.edges.clear();
  const int count = number_blocks(island);
  auto join = [&](int i, int j) { island.matrix.edges.push_back({i, j}); };
  for (size_t k = 0; k < island.tendons.size(); ++k) {
    const Tendon& c = *island.tendons[k];
    const int first = island.matrix.offset[island.numbers[k]];
    for (int reach = 1; reach <= c.matrix.half; ++reach)
      for (int i = first; i + reach < first + c.n(); ++i) join(i, i + reach);
  }
  for (const Contact* contact : island.contacts) {
    if (!contact->joins) continue;
    for (int i : {0, 1})
      for (int j : {0, 1})
        join(block_at(island, contact->a.tendon, contact->a.first + i),
             block_at(island, contact->b.tendon, contact->b.first + j));
  }
  island.matrix.factor.analyse(count, island.matrix.edges);
}

// Adds the band of a tendon. first: block of its first particle.
void add_band(SparseFactor& factor, const Tendon& c, int first) {
  for (int i = 0; i < c.n(); ++i) factor.add(first + i, first + i, full(symmetric_at(c.matrix.diagonal, i)));
  for (int reach = 1; reach <= c.matrix.half; ++reach)
    for (int i = 0; i + reach < c.n(); ++i)
      factor.add(first + i + reach, first + i, block_at(c.matrix.below[reach - 1], i));
}

// By block, the projector on the directions that anchors and direct contacts leave free.
void find_freedom(Island& island) {
  island.matrix.free.assign(island.matrix.factor.blocks(), identity(1));
  auto leave = [&](int tendon, int i, const Sym3& free) {
    island.matrix.free[block_at(island, tendon, i)] = free;
  };
  for (size_t k = 0; k < island.tendons.size(); ++k)
    for (const Anchor& h : island.tendons[k]->anchors)
      if (h.rigid) leave(island.numbers[k], h.particle, {});
  for (const Contact* contact : island.acting)
    if (contact->normal_force.held)
      leave(contact->a.tendon, particle_of(*contact), across(contact->geometry.normal));
}

// Adds the blocks of a contact between tendons that are outside the bands.
void add_coupling(Island& island, const Contact& contact, const ContactMatrix& k) {
  for (int i : {0, 1})
    for (int j : {0, 1}) {
      const int a = block_at(island, contact.a.tendon, contact.a.first + i);
      const int b = block_at(island, contact.b.tendon, contact.b.first + j);
      const Sym3 &free_a = island.matrix.free[a], &free_b = island.matrix.free[b];
      Mat3 part = k.at(i, 2 + j);
      if (trace(free_a) < 3) part = full(free_a) * part;
      if (trace(free_b) < 3) part = part * full(free_b);
      island.matrix.factor.add(a, b, part);
    }
}

bool factorise_coupled(Island& island, bool through) {
  find_pattern(island);
  find_freedom(island);
  island.matrix.factor.start();
  for (size_t k = 0; k < island.tendons.size(); ++k)
    add_band(island.matrix.factor, *island.tendons[k], island.matrix.offset[island.numbers[k]]);
  for (size_t c = 0; c < island.acting.size(); ++c)
    if (island.acting[c]->b.tendon >= 0) add_coupling(island, *island.acting[c], island.of_contacts[c]);
  return island.matrix.factor.factorise(through);
}

// negative: with the negative pivots alone.
void solve_coupled(Island& island, Which b, Which x, bool negative = false) {
  island.matrix.right_hand.resize(island.matrix.factor.blocks());
  int block = 0;
  for (const Tendon* c : island.tendons)
    for (int i = 0; i < c->n(); ++i) island.matrix.right_hand[block++] = (c->*b).at(i);
  if (negative)
    island.matrix.factor.solve_negative(island.matrix.right_hand);
  else
    island.matrix.factor.solve(island.matrix.right_hand);
  block = 0;
  for (Tendon* c : island.tendons)
    for (int i = 0; i < c->n(); ++i) (c->*x).set(i, island.matrix.right_hand[block++]);
}

// A^-1 C for the eight columns of panel p.
void answer_coupled(Island& island, size_t p) {
  Columns& all = island.matrix.right_hands;
  if (!all.fits(island.matrix.factor.blocks())) all.resize(island.matrix.factor.blocks());
  all.zero(0, island.matrix.factor.blocks() - 1);
  for (int k : island.bodies.reaches[p].tendons) {
    const int first = island.matrix.offset[island.numbers[k]], n = island.tendons[k]->n();
    const Columns& pulls = island.bodies.borders[k].panels[p].pulls;
    std::copy(pulls.at(0), pulls.at(n), all.at(first));
  }
  island.matrix.factor.solve(all);
  for (size_t k = 0; k < island.tendons.size(); ++k) {
    const int first = island.matrix.offset[island.numbers[k]], n = island.tendons[k]->n();
    std::copy(all.at(first), all.at(first + n), island.bodies.borders[k].panels[p].answers.at(0));
  }
}

// y += (the blocks of coupling contacts outside the bands) p, with p = cg_direction and y = cg_image.
void add_coupling(Island& island) {
  for (size_t c = 0; c < island.acting.size(); ++c) {
    const Contact& contact = *island.acting[c];
    if (contact.b.tendon < 0) continue;
    const ContactMatrix& k = island.of_contacts[c];
    Tendon &a = island.at(contact.a), &b = island.at(contact.b);
    for (int i : {0, 1})
      for (int j : {0, 1}) {
        const int p = contact.a.first + i, q = contact.b.first + j;
        const Mat3& block = k.at(i, 2 + j);
        a.cg_image.add(p, block * b.cg_direction.at(q));
        b.cg_image.add(q, transposed_times(block, a.cg_direction.at(p)));
      }
  }
}

}  // namespace

void multiply(Island& island) {
  for (Tendon* c : island.tendons) c->matrix.multiply(c->cg_direction, c->cg_image);
  if (!island.coupled) return;
  add_coupling(island);
  project_anchors(island, &Tendon::cg_image);
}

void combine(Island& island, double alpha, Which x, double beta, Which y) {
  for (Tendon* c : island.tendons)
    for (int k = 0; k < 3; ++k) {
      const double* from = (c->*x)[k];
      double* to = (c->*y)[k];
      // What an indefinite matrix left in y may not be finite. Times zero, it would stay there for good.
      for (int i = 0; i < c->n(); ++i) to[i] = alpha * from[i] + (beta == 0 ? 0 : beta * to[i]);
    }
}

namespace {

double inner_product(const Island& island, Which a, Which b) {
  double sum = 0;
  for (const Tendon* c : island.tendons) sum += inner(c->*a, c->*b);
  return sum;
}

void prepare_blocks(Tendon& c) {
  for (int i = 0; i < c.n(); ++i) set(c.inverse_blocks, i, inverse(symmetric_at(c.matrix.diagonal, i)));
}

void precondition(Island& island) {
  for (Tendon* c : island.tendons)
    for (int i = 0; i < c->n(); ++i)
      c->cg_preconditioned.set(i, symmetric_at(c->inverse_blocks, i) * c->cg_remainder.at(i));
}

// x = A^-1 b by preconditioned conjugate gradients from x = 0, to the linear tolerance in the preconditioned
// norm. false: a direction of zero or negative curvature was met.
bool conjugate_gradients(Island& island, const Options& o, Which b, Which x) {
  constexpr Which R = &Tendon::cg_remainder, Z = &Tendon::cg_preconditioned;
  constexpr Which P = &Tendon::cg_direction, Y = &Tendon::cg_image;
  combine(island, 1, b, 0, R);
  combine(island, 0, R, 0, x);
  precondition(island);
  combine(island, 1, Z, 0, P);
  double rz = inner_product(island, R, Z);
  const double relative = std::max(o.linear_tolerance, island.matrix.tolerance);
  const double enough = relative * relative * rz;
  int unknowns = 0;
  for (const Tendon* c : island.tendons) unknowns += 3 * c->n();
  for (int k = 0; k < 2 * unknowns && rz > enough; ++k) {
    multiply(island);
    double py = inner_product(island, P, Y);
    if (!(py > 0)) return false;
    double alpha = rz / py;
    combine(island, alpha, P, 1, x);
    combine(island, -alpha, Y, 1, R);
    precondition(island);
    double rz_next = inner_product(island, R, Z);
    combine(island, 1, Z, rz_next / rz, P);
    rz = rz_next;
  }
  return true;
}

// Returns whether the matrix of the tendons is definite. through: factors an indefinite one completely.
bool factorise(Island& island, const Options& o, bool through) {
  if (o.linear_solver == LinearSolver::pcg) {
    for (Tendon* c : island.tendons) prepare_blocks(*c);
    return true;
  }
  if (island.coupled) return factorise_coupled(island, through);
  bool definite = true;
  for (Tendon* c : island.tendons) definite &= c->factor.factorise(c->matrix);
  return definite;
}

// x = A^-1 b of the tendons, by the factors of the last solution. false: conjugate gradients met a direction
// without positive curvature.
bool apply_inverse(Island& island, const Options& o, Which b, Which x) {
  if (o.linear_solver == LinearSolver::pcg) return conjugate_gradients(island, o, b, x);
  if (island.coupled) {
    solve_coupled(island, b, x);
    return true;
  }
  for (Tendon* c : island.tendons) c->factor.solve(c->*b, c->*x);
  return true;
}

// Computes A^-1 C for the columns of panel p, at least in the blocks of the border.
bool answer_columns(Island& island, const Options& o, size_t p) {
  const bool coupled = island.coupled || o.linear_solver == LinearSolver::pcg;
  for (size_t k = 0; k < island.tendons.size(); ++k) {
    Panel& panel = island.bodies.borders[k].panels[p];
    panel.answered = coupled || panel.pulls_any;
    if (panel.answered && !panel.answers.fits(island.tendons[k]->n()))
      panel.answers.resize(island.tendons[k]->n());
  }
  if (o.linear_solver == LinearSolver::pcg) {
    const int columns = std::min(kLanes, island.bodies.freedom - static_cast<int>(p) * kLanes);
    for (int lane = 0; lane < columns; ++lane) {
      take_column(island, p, lane);
      if (!apply_inverse(island, o, &Tendon::column, &Tendon::solved)) return false;
      put_answer(island, p, lane);
    }
    return true;
  }
  if (island.coupled) {
    answer_coupled(island, p);
    return true;
  }
  for (int k : island.bodies.reaches[p].tendons) {
    Border& b = island.bodies.borders[k];
    if (b.panels[p].answered)
      island.tendons[k]->factor.solve(b.panels[p].pulls, b.first, b.last, b.panels[p].answers);
  }
  return true;
}

size_t panels_of(const Island& island) { return island.bodies.reaches.size(); }

// Whether the Schur complement is positive definite, by its Cholesky factor.
bool is_definite(const Island& island) {
  const int n = island.bodies.freedom;
  for (int k = 0; k < n; ++k)
    if (island.bodies.corner_root[k * n + k] == 0) return false;
  return true;
}

// Computes the Schur complement of the tendons. false: as of apply_inverse.
bool complement(Island& island, const Options& o) {
  for (size_t p = 0; p < panels_of(island); ++p) {
    if (!answer_columns(island, o, p)) return false;
    for (size_t q = p; q < panels_of(island); ++q) take_complement(island, p, q);
  }
  return true;
}

// Computes the Schur complement of the tendons and its Cholesky factor. false: indefinite terms of contacts
// and compressed springs, which are left out if `definite`, exceed the inertia of the bodies.
bool factorise_bodies(Island& island, const Options& o, bool definite) {
  if (!complement(island, o)) return false;
  dense::root(island.bodies.freedom, island.bodies.corner, island.bodies.corner_root);
  return definite || is_definite(island);
}

// Solves for bodies (corner_side) and tendons (x).
bool solve_bodies(Island& island, const Options& o, Which b, Which x) {
  if (!apply_inverse(island, o, b, x)) return false;
  island.bodies.corner_side.resize(island.bodies.freedom);
  for (int m : island.bodies.indices) {
    const GeneralizedBody& body = island.bodies.body(m);
    std::copy(body.unknowns.residual.begin(), body.unknowns.residual.end(),
              island.bodies.corner_side.begin() + body.unknowns.first);
  }
  for (size_t p = 0; p < panels_of(island); ++p) take_steps(island, p, x);
  dense::solve(island.bodies.corner_root, island.bodies.corner_side);
  answer_bodies(island, b);
  return apply_inverse(island, o, &Tendon::column, x);
}

}  // namespace

bool find_negative_curvature(Island& island, const Options& o, Which b, Which x) {
  if (o.linear_solver == LinearSolver::pcg) return false;
  if (island.coupled)
    solve_coupled(island, b, x, true);
  else
    for (Tendon* c : island.tendons) c->factor.solve_negative(c->*b, c->*x);
  return std::any_of(island.tendons.begin(), island.tendons.end(),
                     [x](const Tendon* c) { return (c->*x).largest() > 0; });
}

bool solve_again(Island& island, const Options& o, Which b, Which x) {
  return island.bodies.indices.empty() ? apply_inverse(island, o, b, x) : solve_bodies(island, o, b, x);
}

bool answer_forces(Island& island, const Options& o, Which forces, Which x) {
  load_carried(island, forces);
  start_body_residual(island, 0);
  project_anchors(island, forces);
  return solve_again(island, o, forces, x);
}

bool eliminate_tendons(Island& island, const StepContext& context) {
  context.budget->spend();
  return factorise(island, context.options, false) && complement(island, context.options);
}

bool follow_bodies(Island& island, const StepContext& context, Which x) {
  for (Tendon* c : island.tendons) c->column.zero();
  answer_bodies(island, &Tendon::column);
  return apply_inverse(island, context.options, &Tendon::column, x);
}

bool solve_linear(Island& island, const StepContext& context, bool definite, bool indefinite_too) {
  const Options& o = context.options;
  context.budget->spend();
  if (!factorise(island, o, indefinite_too) && !indefinite_too) return false;
  if (!island.bodies.indices.empty() && !factorise_bodies(island, o, definite)) return false;
  if (!solve_again(island, o, &Tendon::residual, &Tendon::dx)) return false;
  for (Tendon* c : island.tendons)
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) c->dx[k][i] = -c->dx[k][i];
  move_bodies(island, -1, &Tendon::dx);
  return true;
}

}  // namespace bt
