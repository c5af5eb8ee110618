#include "world/report.h"

#include <algorithm>
#include <cmath>
#include <limits>
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

// Segments between two contacts with one tendon, if they need not be at the same place of it [-].
constexpr double kAnywhere = std::numeric_limits<double>::infinity();
// The same, if the tendon winds around it there [-]. Larger: strands that cross another one twice are told.
// Smaller: twists are not.
constexpr double kNextOnOther = 1.5;

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
double turn_as_it_slides(const Tendon& c, const Contact& contact, int k) {
  const double radius = contact.is_round() ? contact.geometry.rim.radius : contact.geometry.radius;
  return std::min(turn_between(c, k - is_free(c, k), k + is_free(c, k + 1)),
                  2 * std::atan(norm(c.x.at(k + 1) - c.x.at(k)) / (2 * radius)));
}

// The part of the turn at a particle for which a force along the normal is needed [rad].
double turn_along(const Tendon& c, int i, Vec3 normal) {
  const Vec3 come = unit_or(c.x.at(i) - c.x.at(i - 1), {}), go = unit_or(c.x.at(i + 1) - c.x.at(i), {});
  return 2 * std::asin(std::min(1.0, std::abs(dot(go - come, normal)) / 2));
}

// Angle by which segment k of a tendon turns around segment m of another one that touches it [rad].
double turn_around(const Contact& contact, const Tendon& c, int k, const Tendon& other, int m) {
  const Vec3 axis = unit_or(other.x.at(m + 1) - other.x.at(m), {});
  return norm(cross(c.x.at(k + 1) - c.x.at(k), axis)) / contact.geometry.radius;
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

// Whether the tendon presses on the same surface, or on the other tendon within so many segments of the
// place, about one segment before or behind a contact. The contacts of both segments of one particle there
// are no arc.
bool has_neighbour(const std::vector<Contact>& contacts, const Contact& contact, bool seen_from_other,
                   double within) {
  auto segments_between = [](const SegmentPoint& p, const SegmentPoint& q) {
    return std::abs(p.first + p.w1 - q.first - q.w1);
  };
  return std::any_of(contacts.begin(), contacts.end(), [&](const Contact& other) {
    const double a = segments_between(contact.a, other.a), b = segments_between(contact.b, other.b);
    const double own = seen_from_other ? b : a;
    return other.normal_force.value > 0 && other.key.kind == contact.key.kind &&
           other.key.tendon == contact.key.tendon && other.key.other == contact.key.other && own > 0.5 &&
           own < 1.5 && (seen_from_other ? a : b) < within;
  });
}

// Keeps a turn if it is the farthest of its tendon, which was not reported yet.
void note_coarse(CoarseTurn& coarse, const CoarseTurn& found) {
  if (std::max(found.sliding, found.winding) <= std::max(coarse.sliding, coarse.winding)) return;
  const int steps = coarse.steps;
  coarse = found;
  coarse.steps = steps;
}

}  // namespace

// Notes the turns of a tendon at a contact with a body that are too far.
void World::find_coarse_turns_on_body(const Contact& contact, Tendon& c, double gravity) {
  if (c.coarse.reported) return;
  const bool mesh = contact.key.kind == ContactKind::bone && scene.shapes[contact.key.other]->surface;
  const int k = contact.a.first;
  for (int i : {k, k + 1}) {
    if (!is_free(c, i)) continue;
    const double angle = turn_between(c, i - 1, i);
    if (angle <= kCoarseTurn || !is_taut_at(c, i, gravity)) continue;
    const bool arc = contact.is_round() && has_neighbour(contacts_.all, contact, false, kAnywhere);
    if (!mesh && angle <= (arc ? kCoarseTurnOnRound : kCoarseTurnAtEdge)) continue;
    const double sliding = std::max(angle, turn_as_it_slides(c, contact, k));
    const double bent = bent_of(c, contact, sliding), mu = contact.friction.coefficient;
    note_coarse(c.coarse, {i, contact.link, -1, angle, sliding, 0, bent, mu});
  }
}

// The same at a contact with another tendon, or with itself. The tendon turns about it at a particle, or its
// segments turn around it, as those of a twist do.
void World::find_coarse_turns_on_tendon(const Contact& contact, bool seen_from_other, double gravity) {
  const SegmentPoint &at = seen_from_other ? contact.b : contact.a,
                     &beside = seen_from_other ? contact.a : contact.b;
  Tendon& c = *step_.slots[at.tendon];
  if (c.coarse.reported) return;
  auto presses_beside = [&](double within) {
    return has_neighbour(contacts_.all, contact, seen_from_other, within);
  };
  const double around = turn_around(contact, c, at.first, *step_.slots[beside.tendon], beside.first);
  for (int i : {at.first, at.first + 1}) {
    if (!is_free(c, i)) continue;
    const double angle = turn_along(c, i, contact.geometry.normal);
    if (std::max(angle, around) <= kCoarseTurnAtEdge || !is_taut_at(c, i, gravity)) continue;
    const double winding = around > kCoarseTurnOnRound && presses_beside(kNextOnOther) ? around : 0;
    if (winding == 0 && angle <= (presses_beside(kAnywhere) ? kCoarseTurnOnRound : kCoarseTurnAtEdge))
      continue;
    const double sliding = std::max(angle, turn_as_it_slides(c, contact, at.first));
    note_coarse(c.coarse, {i, -1, beside.tendon, angle, sliding, winding, 0, contact.friction.coefficient});
  }
}

// Finds the tendons that have turned too far for kCoarseSteps steps. The report names one of those that were
// not reported yet.
void World::find_coarse_turns() {
  const double gravity = norm(step_.context.gravity);
  for (auto [slot, c] : filled(step_.slots)) c.coarse.sliding = c.coarse.winding = 0;
  for (const Contact& contact : contacts_.all) {
    if (contact.key.kind == ContactKind::bore || !(contact.normal_force.value > 0)) continue;
    if (contact.key.kind == ContactKind::tendon) {
      find_coarse_turns_on_tendon(contact, false, gravity);
      find_coarse_turns_on_tendon(contact, true, gravity);
    } else {
      find_coarse_turns_on_body(contact, *step_.slots[contact.a.tendon], gravity);
    }
  }
  for (auto [slot, c] : filled(step_.slots)) {
    CoarseTurn& coarse = c.coarse;
    coarse.steps = coarse.sliding > 0 ? coarse.steps + 1 : 0;
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
  converged &= part.converged && part.stops_settled;
  stops_settled &= part.stops_settled;
  contacts = part.contacts;
  islands = part.islands;
}

}  // namespace bt
