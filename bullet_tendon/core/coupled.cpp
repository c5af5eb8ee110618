// Tendons that touch each other: their bands and what joins them, as one sparse matrix.
#include "stepping.h"

namespace bt {

namespace {

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
