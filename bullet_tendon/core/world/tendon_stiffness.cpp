// How the tendons' wrenches on links, and their particles, change where the links move, for bodies that are
// put into equilibrium.
//
// In a step that holds the bodies, the tendons come to rest among them. The links in question then become
// bodies of six unknowns each, with B the identity (bodies/body_response.h), and the system is linearised at
// the solution. Its Schur complement (solver/body_schur.cpp), less the identity of y, is the second
// derivative of the tendons' potential by the twists of the links, with all particles at rest. Inertia and
// damping of that step are no part of it: they are those of a step of endless length. The same factors give
// the motion of the particles, by which they are carried to the next place of the bodies.
#include <utility>
#include <vector>

#include "solver/assembly.h"
#include "solver/body_schur.h"
#include "solver/solver.h"
#include "world/world.h"

namespace bt {

namespace {

constexpr int kTwist = 6;
// Inertia over its square is 1e-8 of the mass per s^2: enough to keep the matrix of a slack tendon regular
// [s].
constexpr double kEndless = 1e4;

GeneralizedBody body_of_one_link(int number) {
  GeneralizedBody body;
  body.rates.assign(kTwist, 0.0);
  dense::set_identity(kTwist, body.root);
  BodyUnknowns& unknowns = body.unknowns;
  unknowns.any = true;
  unknowns.y.assign(kTwist, 0.0);
  unknowns.dy.assign(kTwist, 0.0);
  unknowns.residual.assign(kTwist, 0.0);
  unknowns.first = kTwist * number;
  unknowns.lever = 1;
  return body;
}

}  // namespace

// false: the tendons' matrix has no factors in either linearisation.
bool World::linearise_tendons(Island& island) {
  for (const bool definite : {false, true}) {
    Assembly a = residual_of(island, true);
    measure_residual(island, a);
    assemble(island, Linearisation::position, definite, definite);
    if (eliminate_tendons(island, step_.context)) return true;
  }
  return false;
}

double World::safe_share(const std::vector<Twist>& of_links, const double* of_particles,
                         DistanceOracle& oracle) {
  step_.whole = false;
  step_.context.dt = 1;
  step_.substeps.start(1, true);
  for (size_t l = 0; l < scene.links.size(); ++l) {
    scene.links[l].drift_rates = of_links[l];
    scene.links[l].foresee({}, 1, false);
  }
  if (!of_particles) step_.slots.clear();
  for (auto [slot, c] : filled(step_.slots)) {
    for (int i = 0; i < c.n(); ++i, of_particles += 3)
      c.x_new.set(i, c.x.at(i) + Vec3{of_particles[0], of_particles[1], of_particles[2]});
    c.predict();
  }
  find_bores();
  update_proximity(oracle);
  limit_motion();
  return step_.motion_limit;
}

void World::carry_tendons(const double* motion) {
  for (auto [slot, c] : filled(scene.tendons))
    for (int i = 0; i < c.n(); ++i, motion += 3) c.x.add(i, {motion[0], motion[1], motion[2]});
}

// Where links and particles are at the end of a step that held the bodies.
void World::keep_held() {
  stiffness.held.clear();
  for (const int l : stiffness.links) stiffness.held.push_back(scene.links[l].pose);
  for (auto [slot, c] : filled(step_.slots)) c.x_before = c.x;
}

// Motion of a contact's point on the tendon relative to its link, or to the other tendon, since the last step
// that held the bodies. Between such steps links are put elsewhere without a velocity, and carry tendons.
Vec3 World::moved_since_held(const Contact& contact) const {
  if (stiffness.held.empty()) return {};
  auto before = [&](const SegmentPoint& at) { return at.of(step_.slots[at.tendon]->x_before); };
  auto moved = [&](const SegmentPoint& at) { return at.of(step_.slots[at.tendon]->x) - before(at); };
  if (contact.b.tendon >= 0) return moved(contact.a) - moved(contact.b);
  const Vec3 x = before(contact.a);
  for (size_t k = 0; k < stiffness.held.size(); ++k)
    if (stiffness.links[k] == contact.link)
      return moved(contact.a) + x - to_world(scene.links[contact.link].pose, to_local(stiffness.held[k], x));
  return moved(contact.a);
}

// The links and bodies of the world are those of the linearisation meanwhile.
void World::find_tendon_stiffness() {
  const int count = static_cast<int>(stiffness.links.size());
  std::vector<GeneralizedBody> bodies;
  for (int k = 0; k < count; ++k) bodies.push_back(body_of_one_link(k));
  std::swap(bodies, scene.bodies);
  const std::vector<Link> links = scene.links;
  for (Link& link : scene.links) link.body = -1;
  for (int k = 0; k < count; ++k) {
    Link& link = scene.links[stiffness.links[k]];
    link.body = k;
    link.jacobian.clear();
    dense::set_identity(kTwist, link.root);
    link.iterate.reached = link.root;
    link.iterate.given = link.iterate.stepped = {};
    link.iterate.turned = {};
    link.iterate.turned.far = true;
  }
  Island island;
  island.slots = &step_.slots;
  for (auto [slot, c] : filled(step_.slots)) {
    island.tendons.push_back(&c);
    island.numbers.push_back(slot);
    for (Anchor& anchor : c.anchors) anchor.moves = anchor.link >= 0 && scene.links[anchor.link].yields();
  }
  for (Contact& contact : contacts_.all) {
    contact.moves = contact.link >= 0 && scene.links[contact.link].yields();
    island.contacts.push_back(&contact);
    island.coupled |= contact.b.tendon >= 0;
  }
  island.bodies.all = &scene.bodies;
  island.bodies.links = &scene.links;
  island.bodies.reach = 1;
  island.bodies.freedom = kTwist * count;
  island.bodies.carried = stiffness.links;
  island.bodies.turn_surfaces = true;
  for (int k = 0; k < count; ++k) island.bodies.indices.push_back(k);
  std::vector<double> steps;
  for (Tendon* c : island.tendons) steps.push_back(std::exchange(c->h_eff, kEndless));
  stiffness.known = linearise_tendons(island);
  stiffness.motion.clear();
  for (int k = 0; k < 6 * count && stiffness.known; ++k) {
    island.bodies.corner_side.assign(6 * count, 0.0);
    island.bodies.corner_side[k] = 1;
    stiffness.known = follow_bodies(island, step_.context, &Tendon::dx);
    move_bodies(island, 1, &Tendon::dx);
    for (const Tendon* c : island.tendons)
      for (int i = 0; i < c->n(); ++i)
        for (int j = 0; j < 3; ++j) stiffness.motion.push_back(c->dx[j][i]);
  }
  for (size_t k = 0; k < steps.size(); ++k) island.tendons[k]->h_eff = steps[k];
  stiffness.matrix = island.bodies.corner;
  for (int k = 0; k < island.bodies.freedom; ++k) stiffness.matrix[k * island.bodies.freedom + k] -= 1;
  for (Tendon* c : island.tendons)
    for (Anchor& anchor : c->anchors) anchor.moves = false;
  for (Contact& contact : contacts_.all) contact.moves = false;
  scene.links = links;
  std::swap(bodies, scene.bodies);
}

}  // namespace bt
