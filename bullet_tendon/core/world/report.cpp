#include "world/report.h"

#include <algorithm>
#include <cmath>
#include <numeric>
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
// 1: 6 % at 20 degrees, 41 % at 45. On round surfaces chords turn by as much at both ends: tendons without
// friction had the same tension at both ends to 2 % (37 cylinders, up to 45 degrees).
constexpr double kCoarseTurnAtEdge = 20 * M_PI / 180;
constexpr double kCoarseTurnOnRound = 45 * M_PI / 180;
// Share of the largest tension in the tendon that it carries there [-]. Larger: wrong tensions are not told.
// Smaller: warnings of what hangs loose behind a hold.
constexpr double kCoarseShare = 0.01;
// Steps for which it lasts [-]. Fewer: impacts are told.
constexpr int kCoarseSteps = 10;

// Angle between the segments of a particle that nothing holds, if it is larger than `most` and both segments
// carry more than the weight of the tendon and that share of its tension; else 0 [rad].
double coarse_turn(const Tendon& c, int i, double most, double gravity) {
  if (i < 1 || i > c.n() - 2) return 0;
  for (const Anchor& h : c.anchors)
    if (h.particle == i) return 0;
  const Vec3 come = c.x.at(i) - c.x.at(i - 1), go = c.x.at(i + 1) - c.x.at(i);
  const double angle = std::atan2(norm(cross(come, go)), dot(come, go));
  if (angle <= most) return 0;
  const double weight = gravity * std::accumulate(c.mass.begin(), c.mass.end(), 0.0);
  const std::vector<double>& tension = c.structure.lambda;
  const double least = std::max(weight, kCoarseShare * *std::max_element(tension.begin(), tension.end()));
  return std::min(tension[i - 1], tension[i]) > least ? angle : 0;
}

}  // namespace

// Finds the tendons that have turned too far for kCoarseSteps steps. The report names one of those that were
// not reported yet.
void World::find_coarse_turns() {
  const double gravity = norm(step_.context.gravity);
  for (auto [slot, c] : filled(step_.slots)) c.coarse.angle = 0;
  for (const Contact& contact : contacts_.all) {
    const bool bone = contact.key.kind == ContactKind::bone;
    if (!(bone || contact.key.kind == ContactKind::mouth) || !(contact.normal_force.value > 0)) continue;
    const bool mesh = bone && scene.shapes[contact.key.other]->surface;
    const double most = mesh ? kCoarseTurn : contact.is_round() ? kCoarseTurnOnRound : kCoarseTurnAtEdge;
    Tendon& c = *step_.slots[contact.a.tendon];
    for (int i : {contact.a.first, contact.a.first + 1}) {
      const double angle = coarse_turn(c, i, most, gravity);
      if (angle <= c.coarse.angle) continue;
      c.coarse = {i, contact.link, angle, contact.friction.coefficient, c.coarse.steps, c.coarse.reported};
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
