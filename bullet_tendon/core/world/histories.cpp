// BDF2 of tendons together with the bodies that they act on (bodies/body_history.h).
//
// What acts on each other continues by BDF2 together, or takes implicit Euler together: only then are
// impulses equal and opposite. Bodies that something else holds or stops have no history. A tendon that acts
// on one of them takes implicit Euler, and so does the rest of its island.
#include "world/world.h"

namespace bt {

namespace {

// Whether a tendon ends a step of implicit Euler after which it may continue with its bodies.
bool begins_history(const Tendon& c) { return c.with_body && c.history == 0; }

}  // namespace

// Calls what(tendon, body) for every attachment and every contact between a tendon and a body that yields.
template <class Do>
void World::each_coupling(Do what) {
  auto call = [&](Tendon& c, int link) {
    if (link >= 0 && scene.links[link].yields()) what(c, scene.bodies[scene.links[link].body]);
  };
  each_anchor(step_.slots, [&](Tendon& c, const Anchor& h) { call(c, h.link); });
  for (const Contact& contact : contacts_.all) call(*step_.slots[contact.a.tendon], contact.link);
}

// Calls what(tendon, tendon) for every contact between tendons.
template <class Do>
void World::each_pair(Do what) {
  for (const Contact& contact : contacts_.all)
    if (contact.b.tendon >= 0) what(*step_.slots[contact.a.tendon], *step_.slots[contact.b.tendon]);
}

// Calls what(key) for every contact that had a force in the last step and is none in this one: its part of
// the mean force, which the history contains, would act on the tendon only.
template <class Do>
void World::each_lost_contact(Do what) {
  contacts_.recalled.assign(contacts_.memory.size(), false);
  for (const Contact& contact : contacts_.all)
    if (const ContactMemory* found = remembered(contact.key))
      contacts_.recalled[found - contacts_.memory.data()] = true;
  for (size_t k = 0; k < contacts_.memory.size(); ++k)
    if (!contacts_.recalled[k]) what(contacts_.memory[k].key);
}

// Predicts bodies with the forces that their histories give.
void World::continue_histories() {
  if (step_.substeps.taken() > 0) return;
  const bool two_step =
      !step_.whole && is_second_order(options.integrator) && options.iteration == Iteration::newton;
  for (size_t m = 0; m < scene.bodies.size(); ++m) {
    GeneralizedBody& body = scene.bodies[m];
    if (!two_step || body.turning.elements) {  // what elements act on takes implicit Euler
      body.history.forget();
    } else if (body.n() > 0) {
      continue_history(static_cast<int>(m));
      lead_links(static_cast<int>(m));
    }
  }
}

void World::continue_history(int body) {
  GeneralizedBody& m = scene.bodies[body];
  const double dt = step_.substeps.step();
  const bool continues = m.begin_history(dt, step_.context.gravity, step_.substeps.is_whole());
  m.history.given.assign(m.n(), 0.0);
  for (Link& l : scene.links) {
    if (l.body != body) continue;
    l.attachment_arms = {};
    if (m.history.admitted && !l.jacobian.empty())
      l.attachment_arms = {true, rotation_of_step(dt * l.rates.angular)};
    if (!continues) continue;
    l.history.begin(m.history.steady_share);
    l.add_generalized(l.jacobian, l.history.given, m.history.given);
  }
  if (continues) m.continue_history(dt);
}

// Determines which tendons are solved together with bodies that have a history. A body has none where
// another body of the same island cannot have one.
void World::find_couplings() {
  for (auto [slot, c] : filled(step_.slots)) c.coupled = c.barred = false;
  for (GeneralizedBody& m : scene.bodies) m.history.coupled = false;
  for (bool any = true; any;) {
    any = false;
    auto set = [&](bool& which, bool value) {
      any |= value != which;
      which = value;
    };
    each_coupling([&](Tendon& c, GeneralizedBody& m) {
      set(c.barred, c.barred || !m.history.admitted);
      set(m.history.admitted, !c.barred);
      set(c.coupled, true);
      m.history.coupled = true;
    });
    each_pair([&](Tendon& a, Tendon& b) {
      set(a.barred, a.barred || b.barred);
      set(b.barred, a.barred);
      set(a.coupled, a.coupled || b.coupled);
      set(b.coupled, a.coupled);
    });
  }
  for (auto [slot, c] : filled(step_.slots)) c.coupled &= !c.barred;
}

// Prepares BDF2 after a step of implicit Euler (bodies/body_history.h). Forces that began with the step leave
// v = u at its end, forces that were there before leave v half a step ahead of u. Known forces were there. Of
// the other forces, that share is taken to have been there with which the change of velocity is, as an
// energy, that by the known forces: all of them at rest and in free fall, few of them after a release.
void World::begin_histories() {
  if (!is_second_order(options.integrator) || step_.whole) return;
  const double dt = step_.substeps.step();
  // Twice the kinetic energy of the change of velocity in the step, by island root [J]: if the known forces
  // had acted alone, and by all forces.
  static thread_local std::vector<double> known, all;  // keep their memory from step to step
  known.assign(scene.tendons.size(), 0.0);
  all.assign(scene.tendons.size(), 0.0);
  for (auto [slot, t] : filled(step_.slots)) {
    if (!begins_history(t)) continue;
    const int root = island_root(slot);
    for (int i = 0; i < t.n(); ++i) {
      const Vec3 change = t.v.at(i) - t.v_before.at(i), by_known = dt * known_acceleration(t, i);
      all[root] += t.mass[i] * dot(change, change);
      known[root] += t.mass[i] * dot(by_known, by_known);
    }
  }
  for (size_t m = 0; m < scene.bodies.size(); ++m) {
    if (!scene.bodies[m].history.begins()) continue;
    const int root = island_root(islands_.touches[m]);
    const auto [of_known, of_all] = scene.bodies[m].energies_of_change(dt);
    known[root] += of_known;
    all[root] += of_all;
  }
  auto steady_share = [&](int tendon) {
    const int root = island_root(tendon);
    return known[root] < all[root] ? known[root] / all[root] : 1.0;
  };
  for (auto [slot, t] : filled(step_.slots)) {
    if (!begins_history(t)) continue;
    const double share = t.steady_share = steady_share(slot);
    for (int i = 0; i < t.n(); ++i) {
      const Vec3 change = t.v.at(i) - t.v_before.at(i);
      t.v.add(i, 0.5 * (share * change + (1 - share) * dt * known_acceleration(t, i)));
      t.v_before.set(i, t.v.at(i) - change);
    }
  }
  for (size_t m = 0; m < scene.bodies.size(); ++m)
    if (scene.bodies[m].history.begins())
      scene.bodies[m].history.steady_share = steady_share(islands_.touches[m]);
  for (GeneralizedBody& m : scene.bodies)
    if (m.history.dt > 0) m.history.known = m.known_acceleration();
}

Vec3 World::known_acceleration(const Tendon& c, int i) const {
  return step_.context.gravity + (1 / c.mass[i]) * c.force.at(i);
}

bool World::share_weights() {
  if (!is_second_order(options.integrator)) return false;
  find_couplings();
  const double dt = step_.context.dt;
  bool changed = false, any = false;
  auto interrupt = [&](auto& of, bool two) {
    any |= of.smooth;
    changed |= of.smooth && two;
    of.smooth = false;
  };
  auto continues = [&](const Tendon& c) { return c.h_eff < dt; };
  auto restart = [&](Tendon& c) { interrupt(c, continues(c)); };
  auto restart_body = [&](GeneralizedBody& m) { interrupt(m.history, m.history.continues); };
  for (auto [slot, c] : filled(step_.slots))
    if (c.barred || (continues(c) && c.coupled != c.with_body)) restart(c);
  for (GeneralizedBody& m : scene.bodies)
    if (m.history.continues && !(m.history.admitted && m.history.coupled)) restart_body(m);
  each_lost_contact([&](const ContactKey& key) {
    for (const int tendon : {key.tendon, key.kind == ContactKind::tendon ? key.other : key.tendon})
      if (step_.slots[tendon] && continues(*step_.slots[tendon])) restart(*step_.slots[tendon]);
  });
  // What acts on each other continues together.
  for (any = true; any;) {
    any = false;
    each_pair([&](Tendon& a, Tendon& b) {
      if (a.smooth == b.smooth && (!a.smooth || a.h_eff == b.h_eff)) return;
      restart(a);
      restart(b);
    });
    each_coupling([&](Tendon& c, GeneralizedBody& m) {
      const bool together = !c.smooth || continues(c) == m.history.continues;
      if (!c.coupled || (c.smooth == m.history.smooth && together)) return;
      restart(c);
      restart_body(m);
    });
  }
  return changed;
}

// Ends the histories of tendons in contact, or of springs that only pull, whose velocities jump in this
// substep. true: there are some.
bool World::restart_jolted() {
  if (!is_second_order(options.integrator) || !carries(options)) return false;
  bool any = false;
  auto judge = [&](Tendon& c) {
    if (c.h_eff == step_.context.dt || !c.smooth || !is_jolted(c, step_.context.dt)) return;
    c.smooth = false;
    any = true;
  };
  for (const Contact& contact : contacts_.all) {
    if (contact.normal_force.value <= 0) continue;
    for (const int tendon : {contact.a.tendon, contact.b.tendon})
      if (tendon >= 0) judge(*step_.slots[tendon]);
  }
  for (auto [slot, c] : filled(step_.slots))
    if (c.material.law.tension_only) judge(c);
  return any;
}

// Whether a force on a tendon gives a part in the next step.
bool World::gives_twice(const Tendon& c) const { return c.coupled && c.h_eff != step_.context.dt; }

// What a force of this mean gives in the substep to what it acts on [N], if it gave `last` in the last step
// (bodies/body_history.h).
Vec3 World::given(const Tendon& c, Vec3 mean, Vec3 last) const {
  if (!gives_twice(c)) return mean;
  return kTwoStepShare * mean + (1 - kTwoStepShare) * c.steady_share * last;
}

}  // namespace bt
