#include "world/report.h"

#include <vector>

#include "world/world.h"

namespace bt {

void World::read_worst(const Group& g) {
  attempt_.residual = g.residual;
  const Chain* worst = g.chains[0];
  for (const Chain* c : g.chains)
    if (!(c->residual_norm <= worst->residual_norm)) worst = c;
  for (size_t c = 0; c < slots_.size(); ++c)
    if (slots_[c] == worst) attempt_.worst_chain = static_cast<int>(c);
  attempt_.worst_particle = worst->worst_particle;
}

void Report::take(const Report& part) {
  if (!(part.residual <= residual) || worst_chain < 0)
    residual = part.residual, worst_chain = part.worst_chain, worst_particle = part.worst_particle;
  converged &= part.converged;
  rows = part.rows, groups = part.groups;
}

namespace {

ContactRecord record_of(const Row& row, const Field& x) {
  ContactRecord r;
  r.chain = row.a.chain, r.segment = row.a.first, r.other_chain = row.b.chain, r.link = row.link;
  r.kind = row.kind, r.position = row.a.of(x), r.normal = row.normal;
  r.distance = row.gap + row.allowed + row.beyond;
  r.normal_force = row.normal_force, r.friction_force = norm(row.tangent_force);
  return r;
}

}  // namespace

std::vector<ContactRecord> World::contacts() const {
  std::vector<ContactRecord> out;
  for (const std::vector<Row>* rows : {&rows_, &asleep_rows_})
    for (const Row& row : *rows) out.push_back(record_of(row, chains[row.a.chain]->x));
  return out;
}

}  // namespace bt
