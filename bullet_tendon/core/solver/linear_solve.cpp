// Solution of A step = -residual for a group of tendons, and for the unknowns of bodies beside them.
//
// A tendon on its own is a band matrix, and tendons that touch each other are a sparse one: direct
// solutions. Where the paper's solver is asked for: conjugate gradients, preconditioned by the inverse
// diagonal blocks. Bodies border the matrix (solver/body_schur.cpp).
#include "solver/linear_solve.h"

#include <algorithm>

#include "solver/assembly.h"
#include "solver/body_schur.h"

namespace bt {

namespace {

// Share of a body's inertia that is left of it in the matrix at least, when what makes contacts and
// compressed springs indefinite is let in [-]. Smaller: wild steps of light bodies. Larger: curvature is cut
// off more often, and iterations are slower.
constexpr double kInertiaLeft = 0.5;

}  // namespace

// y += (the blocks of coupling rows beside the band) p, for p in directions and y in images.
void add_coupling(Group& group) {
  for (const Row* row : group.acting) {
    if (row->b.chain < 0) continue;
    Chain &a = group.at(row->a), &b = group.at(row->b);
    const Vec3 pull_a = row->block * row->b.of(b.cg_direction);
    const Vec3 pull_b = row->block * row->a.of(a.cg_direction);
    pull_back(a.cg_image, row->a, pull_a);
    pull_back(b.cg_image, row->b, pull_b);
  }
}

void multiply(Group& group) {
  for (Chain* c : group.chains) c->matrix.multiply(c->cg_direction, c->cg_image);
  if (!group.coupled) return;
  add_coupling(group);
  project_holds(group, &Chain::cg_image);
}

void combine(Group& group, double alpha, Which x, double beta, Which y) {
  for (Chain* c : group.chains)
    for (int k = 0; k < 3; ++k) {
      const double* from = (c->*x)[k];
      double* to = (c->*y)[k];
      for (int i = 0; i < c->n(); ++i) to[i] = alpha * from[i] + beta * to[i];
    }
}

namespace {

double inner_product(const Group& group, Which a, Which b) {
  double sum = 0;
  for (const Chain* c : group.chains) sum += inner(c->*a, c->*b);
  return sum;
}

void prepare_blocks(Chain& c) {
  for (int i = 0; i < c.n(); ++i) {
    Sym3 b = inverse(c.matrix.block(i));
    const double v[6] = {b.xx, b.xy, b.xz, b.yy, b.yz, b.zz};
    for (int k = 0; k < 6; ++k) c.inverse_blocks[k][i] = v[k];
  }
}

void precondition(Group& group) {
  for (Chain* c : group.chains) {
    const Planes& q = c->inverse_blocks;
    for (int i = 0; i < c->n(); ++i)
      c->cg_preconditioned.set(
          i, Sym3{q[0][i], q[1][i], q[2][i], q[3][i], q[4][i], q[5][i]} * c->cg_remainder.at(i));
  }
}

// x = A^-1 b by preconditioned conjugate gradients from zero, to the linear tolerance in the preconditioned
// norm. false: a direction of no or negative curvature was met.
bool conjugate_gradients(Group& group, const Options& o, Which b, Which x) {
  constexpr Which R = &Chain::cg_remainder, Z = &Chain::cg_preconditioned;
  constexpr Which P = &Chain::cg_direction, Y = &Chain::cg_image;
  combine(group, 1, b, 0, R);
  combine(group, 0, R, 0, x);
  precondition(group);
  combine(group, 1, Z, 0, P);
  double rz = inner_product(group, R, Z);
  const double relative = std::max(o.linear_tolerance, group.linear_tolerance);
  const double enough = relative * relative * rz;
  int unknowns = 0;
  for (const Chain* c : group.chains) unknowns += 3 * c->n();
  for (int k = 0; k < 2 * unknowns && rz > enough; ++k) {
    multiply(group);
    double py = inner_product(group, P, Y);
    if (!(py > 0)) return false;
    double alpha = rz / py;
    combine(group, alpha, P, 1, x);
    combine(group, -alpha, Y, 1, R);
    precondition(group);
    double rz_next = inner_product(group, R, Z);
    combine(group, 1, Z, rz_next / rz, P);
    rz = rz_next;
  }
  return true;
}

bool factorise(Group& group, const Options& o) {
  if (o.linear_solver == LinearSolver::pcg) {
    for (Chain* c : group.chains) prepare_blocks(*c);
    return true;
  }
  if (group.coupled) return factorise_coupled(group);
  bool definite = true;
  for (Chain* c : group.chains) definite &= c->factor.factorise(c->matrix);
  return definite;
}

}  // namespace

bool apply_inverse(Group& group, const Options& o, Which b, Which x) {
  if (o.linear_solver == LinearSolver::pcg) return conjugate_gradients(group, o, b, x);
  if (group.coupled) return solve_coupled(group, b, x), true;
  for (Chain* c : group.chains) c->factor.solve(c->*b, c->*x);
  return true;
}

namespace {

bool is_banded(const Group& group, const Options& o) {
  return !group.coupled && o.linear_solver != LinearSolver::pcg;
}

// Where unknowns of bodies pull at the tendons, at least.
bool apply_inverse_at_border(Group& group, const Options& o, Which b, Which x) {
  if (!is_banded(group, o)) return apply_inverse(group, o, b, x);
  for (size_t k = 0; k < group.chains.size(); ++k) {
    Chain& c = *group.chains[k];
    const Border& at = group.borders[k];
    if (at.first <= at.last) c.factor.solve(c.*b, c.*x, at.first, at.last);
  }
  return true;
}

// The answers of the tendons to what the unknowns of panel p pull at them, where bodies touch them.
bool answer_columns(Group& group, const Options& o, size_t p) {
  const bool banded = is_banded(group, o);
  for (size_t k = 0; k < group.chains.size() && banded; ++k) {
    Border& b = group.borders[k];
    if (b.first <= b.last)
      group.chains[k]->factor.solve(b.panels[p].pulls, b.first, b.last, b.panels[p].answers);
  }
  for (int lane = 0; lane < kLanes && !banded && static_cast<int>(p) * kLanes + lane < group.freedom;
       ++lane) {
    take_column(group, p, lane);
    if (!apply_inverse(group, o, &Chain::column, &Chain::solved)) return false;
    put_answer(group, p, lane);
  }
  return true;
}

// Whether the complement, of which the inertia of the bodies is the identity, is more than a share of that.
bool keeps_inertia(Group& group) {
  const int n = group.freedom;
  for (int k = 0; k < n; ++k) group.corner[k * n + k] -= kInertiaLeft;
  dense::root(n, group.corner, group.corner_root);
  bool keeps = true;
  for (int k = 0; k < n; ++k) {
    group.corner[k * n + k] += kInertiaLeft;
    keeps &= group.corner_root[k * n + k] > 0;
  }
  return keeps;
}

size_t panels_of(const Group& group) { return (group.freedom + kLanes - 1) / kLanes; }

// The complement of the tendons, and its root.
bool factorise_bodies(Group& group, const Options& o, bool definite) {
  for (size_t p = 0; p < panels_of(group); ++p) {
    if (!answer_columns(group, o, p)) return false;
    for (size_t q = p; q < panels_of(group); ++q) take_complement(group, p, q);
  }
  if (!definite && !keeps_inertia(group)) return false;
  dense::root(group.freedom, group.corner, group.corner_root);
  return true;
}

// What bodies make of it beside the tendons, to corner_side.
bool solve_bodies(Group& group, const Options& o, Which b, Which x) {
  if (!apply_inverse_at_border(group, o, b, x)) return false;
  group.corner_side.resize(group.freedom);
  for (int m : group.bodies) {
    const Mover& mover = (*group.movers)[m];
    std::copy(mover.residual.begin(), mover.residual.end(), group.corner_side.begin() + mover.first);
  }
  for (size_t p = 0; p < panels_of(group); ++p) take_steps(group, p, x);
  dense::solve(group.corner_root, group.corner_side);
  answer_bodies(group, b);
  return apply_inverse(group, o, &Chain::column, x);
}

}  // namespace

bool solve_again(Group& group, const Options& o, Which b, Which x) {
  return group.bodies.empty() ? apply_inverse(group, o, b, x) : solve_bodies(group, o, b, x);
}

bool solve_linear(Group& group, const StepContext& context, bool definite) {
  const Options& o = context.options;
  context.budget->spend();
  if (!factorise(group, o)) return false;
  if (!group.bodies.empty() && !factorise_bodies(group, o, definite)) return false;
  if (!solve_again(group, o, &Chain::residual, &Chain::step)) return false;
  for (Chain* c : group.chains)
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < c->n(); ++i) c->step[k][i] = -c->step[k][i];
  move_bodies(group, -1, &Chain::step);
  return true;
}

namespace {

// Tendons that touch each other: their bands and what joins them, as one sparse matrix.

int block_at(const Group& group, int chain, int i) { return group.offset[chain] + i; }

// Returns how many there are.
int number_blocks(Group& group) {
  group.offset.assign(group.slots->size(), -1);
  int count = 0;
  for (size_t k = 0; k < group.chains.size(); ++k) {
    group.offset[group.numbers[k]] = count;
    count += group.chains[k]->n();
  }
  return count;
}

// Which blocks are joined: by all contacts that were pressed once in this solution, so that the pattern
// lasts.
void find_pattern(Group& group) {
  bool same = group.factor.blocks() > 0 && group.patterned;
  for (Row* row : group.acting)
    if (row->b.chain >= 0 && !row->joins) row->joins = true, same = false;
  if (same) return;
  group.patterned = true;
  group.edges.clear();
  const int count = number_blocks(group);
  auto join = [&](int i, int j) {
    if (i != j) group.edges.push_back({i, j});
  };
  for (size_t k = 0; k < group.chains.size(); ++k) {
    const Chain& c = *group.chains[k];
    const int first = group.offset[group.numbers[k]];
    for (int reach = 1; reach <= c.matrix.half; ++reach)
      for (int i = first; i + reach < first + c.n(); ++i) join(i, i + reach);
  }
  for (const Row* row : group.rows) {
    if (!row->joins) continue;
    for (int i : {0, 1})
      for (int j : {0, 1})
        join(block_at(group, row->a.chain, row->a.first + i),
             block_at(group, row->b.chain, row->b.first + j));
  }
  group.factor.analyse(count, group.edges);
}

// first: block of the tendon's first particle.
void add_band(SparseFactor& factor, const Chain& c, int first) {
  for (int i = 0; i < c.n(); ++i) factor.add(first + i, first + i, block_of(c.matrix.block(i)));
  for (int reach = 1; reach <= c.matrix.half; ++reach)
    for (int i = 0; i + reach < c.n(); ++i) {
      Block3 b;
      for (int e = 0; e < 9; ++e) b.v[e] = c.matrix.below[reach - 1][e][i];
      factor.add(first + i + reach, first + i, b);
    }
}

// What holds leave free of every block's particle, as a projector.
void find_freedom(Group& group) {
  group.free.assign(group.factor.blocks(), identity(1));
  auto leave = [&](int chain, int i, const Sym3& free) { group.free[block_at(group, chain, i)] = free; };
  for (size_t k = 0; k < group.chains.size(); ++k)
    for (const Hold& h : group.chains[k]->holds)
      if (h.rigid) leave(group.numbers[k], h.particle, {});
  for (const Row* row : group.acting)
    if (row->held) leave(row->a.chain, row->a.w0 != 0 ? row->a.first : row->a.first + 1, across(row->normal));
}

// The blocks of a contact between tendons that are beside the bands.
void add_coupling(Group& group, const Row& row) {
  const int a[2] = {block_at(group, row.a.chain, row.a.first), block_at(group, row.a.chain, row.a.first + 1)};
  const int b[2] = {block_at(group, row.b.chain, row.b.first), block_at(group, row.b.chain, row.b.first + 1)};
  const Block3 block = block_of(-1.0 * row.block);
  for (int i : {0, 1})
    for (int j : {0, 1}) {
      const double weight = (i ? row.a.w1 : row.a.w0) * (j ? row.b.w1 : row.b.w0);
      if (weight == 0) continue;
      Block3 part = product(product(block_of(group.free[a[i]]), block), block_of(group.free[b[j]]));
      for (double& v : part.v) v *= weight;
      group.factor.add(a[i], b[j], part);
    }
  for (int k = 0; k < row.levers; ++k)
    for (int i : {0, 1})
      for (int j : {0, 1}) {
        const Vec3 p = row.lever_share[k] * (group.free[a[i]] * row.lever[k][i]);
        const Vec3 q = group.free[b[j]] * row.lever[k][2 + j];
        group.factor.add(a[i], b[j],
                         {p.x * q.x, p.x * q.y, p.x * q.z, p.y * q.x, p.y * q.y, p.y * q.z, p.z * q.x,
                          p.z * q.y, p.z * q.z});
      }
}

}  // namespace

bool factorise_coupled(Group& group) {
  find_pattern(group);
  find_freedom(group);
  group.factor.start();
  for (size_t k = 0; k < group.chains.size(); ++k)
    add_band(group.factor, *group.chains[k], group.offset[group.numbers[k]]);
  for (const Row* row : group.acting)
    if (row->b.chain >= 0) add_coupling(group, *row);
  return group.factor.factorise();
}

void solve_coupled(Group& group, Which b, Which x) {
  group.right_hand.resize(group.factor.blocks());
  int block = 0;
  for (const Chain* c : group.chains)
    for (int i = 0; i < c->n(); ++i) group.right_hand[block++] = (c->*b).at(i);
  group.factor.solve(group.right_hand);
  block = 0;
  for (Chain* c : group.chains)
    for (int i = 0; i < c->n(); ++i) (c->*x).set(i, group.right_hand[block++]);
}

}  // namespace bt
