// The previous step is solved again if a body that was predicted as held was released in it, or if an
// unpredicted force acted on a body.
//
// pybullet shows a force of the user, or an impact, only by the motion that it has caused. By then the body,
// and the end of a tendon on it, have moved by F dt^2/m without resistance of the tendon. To undo this motion
// within one step would take a velocity of the distance over dt. Therefore the step is solved again with the
// observed acceleration.
#include <algorithm>
#include <utility>
#include <vector>

#include "world/world.h"

namespace bt {

namespace {

// The step is solved again if the unpredicted motion of a body stretches its tendon by more than this share
// of the tendon's length [-]. Larger: the response to a sudden force is a step late. Smaller: small impacts
// are solved twice.
constexpr double kSuddenPull = 1e-4;
// Largest unpredicted rotation for which the step is solved again [rad]; the prediction uses lever arms at
// the start. It is also the largest motion across the tendon, over the tendon's length [-], of a body whose
// speed pybullet limited. Larger: bodies that spin gain energy.
constexpr double kFarthestTurn = 0.2;

bool same_anchors(const TendonState& a, const TendonState& b) {
  return std::equal(a.anchors.begin(), a.anchors.end(), b.anchors.begin(), b.anchors.end(),
                    [](const Anchor& h, const Anchor& g) { return h.id == g.id; });
}

bool same_anchors(const Checkpoint& a, const Checkpoint& b) {
  auto same = [](const TendonCheckpoint& t, const TendonCheckpoint& u) {
    return t.alive == u.alive && (!t.alive || same_anchors(t.state, u.state));
  };
  return std::equal(a.tendons.begin(), a.tendons.end(), b.tendons.begin(), b.tendons.end(), same);
}

// Copies the target and the parameters that the user may have set since the step that was solved again.
void choose_again(const Anchor& chosen, Anchor& anchor) {
  anchor.target.goal = chosen.target.goal;
  anchor.viscosity = chosen.viscosity;
  anchor.most_force = chosen.most_force;
  anchor.line.most_force = chosen.line.most_force;
  anchor.line.spring = chosen.line.spring;
  anchor.exact = chosen.exact;
  anchor.clamped = chosen.clamped;
  anchor.direction = chosen.direction;
  if (chosen.link >= 0) return;  // each step finds these of attachments
  anchor.rigid = chosen.rigid;
  anchor.stiffness = chosen.stiffness;
}

}  // namespace

void World::let_go(int body) {
  scene.bodies[body].observer.let_go();
  predict(body);
  interrupt();
}

void World::accept_resolve(bool was_read) {
  const double dt = was_read ? history_.last_step.dt : 0;
  for (auto [slot, c] : filled(scene.tendons)) {
    const std::vector<Anchor>& taken = history_.taken->tendons[slot].state.anchors;
    for (size_t h = 0; h < c.anchors.size(); ++h) {
      choose_again(taken[h], c.anchors[h]);
      c.anchors[h].force.late = dt * (c.anchors[h].force.read - taken[h].force.read);
    }
  }
  for (size_t i = 0; i < scene.links.size(); ++i) {
    Link& l = scene.links[i];
    l.late = dt * l.read + -dt * history_.taken->links[i].read;
  }
}

// Puts links and bodies where they were read for the step that began at history_.start, and predicts them
// with the observers' present data, and the forces of the step before.
void World::put_bodies_back() {
  const std::vector<Link>& links = history_.start->sensed_links;
  std::vector<GeneralizedBody>& bodies = history_.start->sensed_bodies;
  for (size_t i = 0; i < std::min(scene.links.size(), links.size()); ++i) scene.links[i] = links[i];
  for (size_t i = 0; i < std::min(scene.bodies.size(), bodies.size()); ++i) {
    GeneralizedBody& body = scene.bodies[i];
    if (body.n() == bodies[i].n()) {  // else it moved together with others, or by itself
      if (bodies[i].inertia.is_slender()) body.observer.turn_to(bodies[i].inertia.axes, bodies[i].free);
      body.observer.expect(bodies[i].observer.forces());
      std::swap(body.observer, bodies[i].observer);
      std::swap(body.stops.motors, bodies[i].stops.motors);
      bodies[i].stops.correct_constraints(body.stops);
    }
    body = bodies[i];
    predict(static_cast<int>(i));
  }
}

// Returns to the start of the step at history_.start, with what is known of the bodies now.
void World::return_to_start(const StepRecord& step) {
  std::vector<Link> links = scene.links;
  std::vector<GeneralizedBody> bodies = scene.bodies;
  apply(*history_.start);
  scene.links.swap(links);
  scene.bodies.swap(bodies);
  step_.context.dt = step.dt;
  step_.context.gravity = step.gravity;
  put_bodies_back();
}

// Begins the present step again.
void World::begin_again(Reason why) {
  return_to_start({step_.substeps.step(), step_.context.gravity});
  history_.may_resolve = true;
  step_.substeps.begin_again(why);
  wake_tendons();
}

std::vector<int> World::released_bodies() const {
  return slots_where(scene.bodies, [](const GeneralizedBody& m) { return m.released(); });
}

// Stretch of a tendon by the motion of the attached point away from its particle, over the tendon's length
// [-]. -1: the body turned too far, or pybullet limited its speed while it moved across the tendon.
double World::pulled_away(const Tendon& c, const Anchor& h) const {
  const Link& link = scene.links[h.link];
  const GeneralizedBody& body = scene.bodies[link.body];
  const dense::Numbers& missed = body.observer.missed();
  const double square = history_.last_step.dt * history_.last_step.dt;
  const Vec3 at = to_world(link.pose, h.local), here = c.x.at(h.particle), gone = at - here;
  const Vec3 angular{missed[3], missed[4], missed[5]};
  double stretch = 0, length = 0, across = 0;
  for (double l : c.rest) length += l;
  for (int i : {h.particle - 1, h.particle + 1}) {
    if (i < 0 || i >= c.n()) continue;
    const Vec3 along = unit_or(here - c.x.at(i), {});
    stretch = std::max(stretch, dot(gone, along));
    across = std::max(across, norm(without(gone, along)));
  }
  const bool cut_off = !body.observer.was_cut() && largest_of(body.rates.data(), body.n()) >= kMostRate;
  if (square * norm(angular) > kFarthestTurn || (cut_off && across > kFarthestTurn * length)) return -1;
  return stretch / length;
}

std::vector<int> World::pulled_bodies() const {
  if (!history_.may_resolve) return {};
  std::vector<double> most(scene.bodies.size());
  for (auto [slot, c] : filled(scene.tendons))
    for (const Anchor& h : c.anchors) {
      if (h.link < 0 || h.is_line || !scene.links[h.link].yields() || !scene.links[h.link].jacobian.empty())
        continue;
      const Observer& seen = scene.bodies[scene.links[h.link].body].observer;
      if (seen.missed().empty() || seen.held()) continue;
      double& of_body = most[scene.links[h.link].body];
      const double away = pulled_away(c, h);
      of_body = away < 0 || of_body < 0 ? -1 : std::max(of_body, away);
    }
  return slots_where(most, [](double away) { return away > kSuddenPull; });
}

bool World::rewind(const std::vector<int>& pulled) {
  const std::vector<int> released = released_bodies();
  for (int i : released)
    if (scene.bodies[i].observer.released()) scene.bodies[i].observer.release();
  const Checkpoint& last = *history_.taken;
  capture(*history_.taken);
  const bool back = !(released.empty() && pulled.empty()) && last.may_resolve && history_.start->valid &&
                    same_anchors(*history_.start, last);
  if (back) {
    for (int i : pulled) scene.bodies[i].observer.trust_last();
    for (GeneralizedBody& m : scene.bodies) m.stops.motors.again = true;
    return_to_start(last.last_step);
    history_.last_step = last.last_step;
    contacts_.all.clear();
    for (auto [slot, c] : filled(scene.tendons))
      if (last.tendons[slot].state.sleeping_island < 0) wake_tendon(slot);
  }
  for (int i : released)
    if (!back) predict(i);
  if (!released.empty()) interrupt();
  // The next step needs these contacts of bodies. pybullet may list later ones (restoreState).
  for (size_t i = 0; back && i < last.bodies.size(); ++i) {
    scene.bodies[i].stops.contacts = last.bodies[i].stops.contacts;
    scene.bodies[i].stops.contacts_known = true;
  }
  return back;
}

}  // namespace bt
