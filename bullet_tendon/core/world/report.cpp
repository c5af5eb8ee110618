#include "world/report.h"

#include <vector>

#include "world/world.h"

namespace bt {

void World::read_worst(const Island& g) {
  step_.attempt.residual = g.result.residual;
  const Tendon* worst = g.tendons[0];
  for (const Tendon* c : g.tendons)
    if (!(c->residual_norm <= worst->residual_norm)) worst = c;
  for (size_t c = 0; c < step_.slots.size(); ++c)
    if (step_.slots[c] == worst) step_.attempt.worst_tendon = static_cast<int>(c);
  step_.attempt.worst_particle = worst->worst_particle;
}

void Report::take(const Report& part) {
  if (!(part.residual <= residual) || worst_tendon < 0) {
    residual = part.residual;
    worst_tendon = part.worst_tendon;
    worst_particle = part.worst_particle;
  }
  converged &= part.converged;
  contacts = part.contacts;
  islands = part.islands;
}

namespace {

ContactRecord record_of(const Contact& contact, const Field& x) {
  ContactRecord r;
  r.tendon = contact.a.tendon;
  r.segment = contact.a.first;
  r.other_tendon = contact.b.tendon;
  r.link = contact.link;
  r.kind = contact.key.kind;
  r.position = contact.a.of(x);
  r.normal = contact.geometry.normal;
  r.distance = contact.geometry.gap + contact.geometry.depth_allowance + contact.geometry.margin;
  r.normal_force = contact.normal_force.value;
  r.friction_force = norm(contact.friction.force);
  return r;
}

}  // namespace

std::vector<ContactRecord> World::contacts() const {
  std::vector<ContactRecord> out;
  for (const std::vector<Contact>* contacts : {&contacts_.all, &contacts_.asleep})
    for (const Contact& contact : *contacts)
      out.push_back(record_of(contact, scene.tendons[contact.a.tendon]->x));
  return out;
}

}  // namespace bt
