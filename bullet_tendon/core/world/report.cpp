#include "world/report.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "world/world.h"

namespace bt {

namespace {

// Turn of a taut tendon at one particle on a mesh, up to which the tension on both sides of a bone was the
// same to 6 % without friction (261 of 261 coarse bones; beyond it 17 of 39) [rad]. Larger: wrong tensions
// are not told. Smaller: warnings of right ones.
constexpr double kCoarseTurn = 15 * M_PI / 180;
// The same at edges and mouths [rad]. A chord that turns by the angles a and b at its ends has the tensions
// T_a cos a = T_b cos b beside it. So a turn by an angle at one particle changes the tension by up to 1/cos -
// 1: 6 % at 20 degrees, 41 % at 45. On round surfaces several chords turn by as much at both ends: tendons
// without friction had the same tension at both ends to 2 % (37 cylinders, up to 45 degrees).
constexpr double kCoarseTurnAtEdge = 20 * M_PI / 180;
constexpr double kCoarseTurnOnRound = 45 * M_PI / 180;
// Share of the largest tension in the tendon that it carries there [-]. Larger: wrong tensions are not told.
// Smaller: warnings of what hangs loose behind a hold.
constexpr double kCoarseShare = 0.01;
// Steps for which it lasts [-]. Fewer: impacts are told.
constexpr int kCoarseSteps = 10;

// Whether a particle is no end, and nothing holds it.
bool is_free(const Tendon& c, int i) {
  return i > 0 && i < c.n() - 1 &&
         std::none_of(c.anchors.begin(), c.anchors.end(), [&](const Anchor& h) { return h.particle == i; });
}

// Angle between two segments [rad].
double turn_between(const Tendon& c, int k, int m) {
  const Vec3 come = c.x.at(k + 1) - c.x.at(k), go = c.x.at(m + 1) - c.x.at(m);
  return std::atan2(norm(cross(come, go)), dot(come, go));
}

// Whether both segments of a particle carry more than the weight of the tendon and a share of its tension.
bool is_taut_at(const Tendon& c, int i, double gravity) {
  const double weight = gravity * std::accumulate(c.mass.begin(), c.mass.end(), 0.0);
  const std::vector<double>& tension = c.structure.lambda;
  const double least = std::max(weight, kCoarseShare * *std::max_element(tension.begin(), tension.end()));
  return std::min(tension[i - 1], tension[i]) > least;
}

// Largest turn of a particle that slides past a contact [rad]: the whole turn there. Where several segments
// touch a circle, it is that of those that touch it at their middles, 2 atan(l/2R).
double turn_as_it_slides(const Tendon& c, const Contact& contact) {
  const int k = contact.a.first;
  const double radius = contact.is_round() ? contact.geometry.rim.radius : contact.geometry.radius;
  return std::min(turn_between(c, k - is_free(c, k), k + is_free(c, k + 1)),
                  2 * std::atan(norm(c.x.at(k + 1) - c.x.at(k)) / (2 * radius)));
}

// The part of a turn [rad] that is on the other side of a contact with the mouth, since its segment bends by
// half of its bend at each end. One that bends fully has the largest difference of both sides where it
// touches the mouth at a quarter: the turns at its ends have sines as 3 to 1, and 3/4 of the larger is on its
// side.
double bent_of(const Tendon& c, const Contact& contact, double turn) {
  const int k = contact.a.first;
  const double bend = std::max(norm(contact.geometry.bend[0]), norm(contact.geometry.bend[1]));
  return std::min(turn - 0.75 * std::atan2(3 * std::sin(turn), 1 + 3 * std::cos(turn)),
                  bend / (2 * norm(c.x.at(k + 1) - c.x.at(k))));
}

// Whether a segment next to that of a contact presses on the same surface.
bool has_neighbour(const std::vector<Contact>& contacts, const Contact& contact) {
  return std::any_of(contacts.begin(), contacts.end(), [&](const Contact& other) {
    return other.normal_force.value > 0 && other.key.kind == contact.key.kind &&
           other.key.tendon == contact.key.tendon && other.key.other == contact.key.other &&
           std::abs(other.key.feature - contact.key.feature) == 1;
  });
}

}  // namespace

// Finds the tendons that have turned too far for kCoarseSteps steps. The report names one of those that were
// not reported yet.
void World::find_coarse_turns() {
  const double gravity = norm(step_.context.gravity);
  for (auto [slot, c] : filled(step_.slots)) c.coarse.angle = c.coarse.sliding = 0;
  for (const Contact& contact : contacts_.all) {
    const bool bone = contact.key.kind == ContactKind::bone;
    if (!(bone || contact.key.kind == ContactKind::mouth) || !(contact.normal_force.value > 0)) continue;
    const bool mesh = bone && scene.shapes[contact.key.other]->surface;
    Tendon& c = *step_.slots[contact.a.tendon];
    for (int i : {contact.a.first, contact.a.first + 1}) {
      if (!is_free(c, i)) continue;
      const double angle = turn_between(c, i - 1, i);
      if (angle <= kCoarseTurn || !is_taut_at(c, i, gravity)) continue;
      const bool arc = contact.is_round() && has_neighbour(contacts_.all, contact);
      if (!mesh && angle <= (arc ? kCoarseTurnOnRound : kCoarseTurnAtEdge)) continue;
      const double sliding = std::max(angle, turn_as_it_slides(c, contact));
      if (sliding <= c.coarse.sliding) continue;
      const double bent = bent_of(c, contact, sliding), mu = contact.friction.coefficient;
      c.coarse = {i, contact.link, angle, sliding, bent, mu, c.coarse.steps, c.coarse.reported};
    }
  }
  for (auto [slot, c] : filled(step_.slots)) {
    CoarseTurn& coarse = c.coarse;
    coarse.steps = coarse.angle > 0 ? coarse.steps + 1 : 0;
    if (coarse.steps >= kCoarseSteps && !coarse.reported) step_.report.coarse_tendon = slot;
  }
}

// Cartilage that was pressed by more than its thickness, and was not reported yet.
void World::find_flat_cartilage() {
  for (auto [slot, c] : filled(scene.cartilages))
    if (c.flattening.depth > 0 && !c.flattening.reported) step_.report.flat_cartilage = slot;
}

// Sets what a user reads of the step's forces. What the step before lacked when it was read is added to it.
void World::let_read() {
  const double per_time = step_.whole ? 0 : 1 / step_.substeps.step();
  for (auto [slot, c] : filled(scene.tendons))
    for (Anchor& h : c.anchors) h.force.read = h.force.of_step + per_time * std::exchange(h.force.late, {});
  for (Link& l : scene.links) l.read = l.wrench + per_time * std::exchange(l.late, {});
}

void World::read_worst(const Island& g) {
  step_.attempt.residual = g.result.residual;
  if (g.tendons.empty()) return;
  const Tendon* worst = g.tendons[0];
  for (const Tendon* c : g.tendons)
    if (!(c->residual_norm <= worst->residual_norm)) worst = c;
  for (auto [slot, c] : filled(step_.slots))
    if (&c == worst) step_.attempt.worst_tendon = slot;
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

}  // namespace bt
