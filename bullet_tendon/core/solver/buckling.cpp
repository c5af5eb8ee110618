// Struts: tendons that are straight under compression. They are saddles of the step's potential.
//
// A strut without bending stiffness is unstable in a zigzag of its particles. Bending stiffness makes the
// zigzag stable. The strut then buckles in a long wave, which grows from a small disturbance by a small share
// in each step of a descent. Therefore the mode is computed: a direction of negative curvature, by the
// negative pivots of the tendons' matrix (More and Sorensen 1979). It is how the particles that were
// eliminated before such a pivot follow its own. Bodies stay.
//
// A strut whose buckling takes longer than a step is no saddle of the step's potential: inertia makes it
// stable. It buckles over many steps if it is not straight to the last bit.
#include <algorithm>
#include <cmath>

#include "math/rotation.h"
#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"

namespace bt {

namespace {

// Growth, see below, above which a solution may be a saddle [-]. Larger: more struts stand that have no
// bending stiffness. Smaller: slack tendons are looked at too, which buckle slowly.
constexpr double kStrut = 10.0;

// Growth above which struts are not left straight [-]: by a tenth in a step. Larger: weak struts stand in
// short steps. Smaller: rounding bends tendons on which nothing acts.
constexpr double kGrowth = 0.01;

// Deviation, over the segment, that a strut has at least [-], against which it grows. Larger: struts that are
// stable are visibly bent. Smaller: rounding hides it, and buckling begins later.
constexpr double kImperfection = 1e-9;

// Negative transverse stiffness of spring k, over the inertia of its particles in this step [-]: the square
// of the rate at which a zigzag grows, times the step.
double growth(const Tendon& c, int k) {
  const SpringSet& springs = c.structure;
  return -4 * springs.force[k] * c.h_eff * c.h_eff / (springs.lighter[k] * springs.length[k]);
}

// Whether a spring is compressed so much that inertia does not keep its particles from moving across it.
bool is_strut(const Tendon& c) {
  for (int k = 0; k < c.structure.count; ++k)
    if (growth(c, k) > kStrut) return true;
  return false;
}

// Unit vector across the tendon at inner particle i, turned about the tendon by an angle [rad].
Vec3 crosswise(const Tendon& c, int i, double angle) {
  const Vec3 along = unit_or(c.x_new.at(i + 1) - c.x_new.at(i - 1), {0, 0, 1});
  const Vec3 side = any_perpendicular(along);
  return std::cos(angle) * side + std::sin(angle) * cross(along, side);
}

// Whether both segments of particle i are in one line, and so compressed that this ends soon.
bool is_straight_strut(const Tendon& c, int i) {
  if (c.structure.force[i - 1] >= 0 || c.structure.force[i] >= 0) return false;  // most of them
  if (std::min(growth(c, i - 1), growth(c, i)) < kGrowth) return false;
  const Vec3 before = c.x_new.at(i) - c.x_new.at(i - 1), after = c.x_new.at(i + 1) - c.x_new.at(i);
  return norm(cross(before, after)) <= 0.5 * kImperfection * norm(before) * norm(after);
}

double largest_step(const Island& island) {
  double most = 0;
  for (const Tendon* c : island.tendons) most = std::max(most, c->dx.largest());
  return most;
}

// Bends the tendon at particle i by impulses without a sum or a moment, on it and on its neighbours.
void bend(Tendon& c, int i) {
  const double least = std::min({c.mass[i - 1], c.mass[i], c.mass[i + 1]});
  const double deviation = kImperfection * std::min(c.rest[i - 1], c.rest[i]);
  const Vec3 impulse = deviation * least * crosswise(c, i, kGoldenAngle * i);
  const double share = norm(c.x_new.at(i) - c.x_new.at(i - 1)) / norm(c.x_new.at(i + 1) - c.x_new.at(i - 1));
  c.move(i - 1, (share - 1) / c.mass[i - 1] * impulse);
  c.move(i, 1 / c.mass[i] * impulse);
  c.move(i + 1, -share / c.mass[i + 1] * impulse);
}

}  // namespace

bool has_struts(const Island& island) {
  return std::any_of(island.tendons.begin(), island.tendons.end(),
                     [](const Tendon* c) { return is_strut(*c); });
}

bool find_buckling_mode(Island& island, const Options& options) {
  double segment = HUGE_VAL;
  for (Tendon* c : island.tendons) {
    c->residual.zero();
    if (!is_strut(*c)) continue;
    segment = std::min(segment, c->shortest_rest());
    for (int i = 1; i + 1 < c->n(); ++i) c->residual.set(i, crosswise(*c, i, kGoldenAngle * i / c->n()));
  }
  project_anchors(island, &Tendon::residual);
  if (!find_negative_curvature(island, options, &Tendon::residual, &Tendon::dx)) return false;
  const double share = segment / largest_step(island);
  combine(island, share, &Tendon::dx, 0, &Tendon::dx);
  island.bodies.corner_side.assign(island.bodies.freedom, 0.0);
  move_bodies(island, 0, &Tendon::dx);
  island.curved = false;
  return std::isfinite(share) && std::isfinite(largest_step(island));
}

void bend_straight_struts(Island& island) {
  bool any = false;
  for (Tendon* c : island.tendons)
    for (int i = 1; i + 1 < c->n(); ++i) {
      if (!is_straight_strut(*c, i)) continue;
      bend(*c, i);
      any = true;
    }
  if (!any) return;
  for (Tendon* c : island.tendons) c->place_anchors();
  place_bodies(island);
}

}  // namespace bt
