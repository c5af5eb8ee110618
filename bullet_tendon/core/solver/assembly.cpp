// Residual and matrix of Newton's method at tendon.x_new, term by term.
#include "solver/assembly.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "collision/narrow_phase.h"
#include "solver/body_schur.h"

namespace bt {

namespace {

// Force at which springs without a multiplier are linearised, relative to the largest residual force [-]. 0:
// a slack tendon of a stiffening law has no stiffness, and a load propagates by one segment per iteration.
// Larger: slack tendons are too stiff in the matrix, and more iterations are needed.
constexpr double kFloorShare = 1e-2;

// Residual of one tendon at tendon.x_new: inertia, springs, bending and soft anchors. Returns the largest
// force [N].
double tendon_residual(Tendon& c) {
  const double inverse = 1 / (c.h_eff * c.h_eff);
  const double* mass = c.mass.data();
  for (int k = 0; k < 3; ++k) {
    const double *u = c.displacement[k], *y = c.inertial_displacement[k];
    double* r = c.residual[k];
    for (int i = 0; i < c.n(); ++i) r[i] = mass[i] * inverse * (u[i] - y[i]);
  }
  double largest = c.residual.largest();
  for (SpringSet* s : {&c.structure, &c.shear}) {
    if (s->count == 0) continue;
    largest = std::max(largest, evaluate(*s, c.material.law, c.motion()));
    scatter_forces(*s, c.residual);
  }
  add_bending_forces(c, c.x_new);
  add_soft_anchors(c, c.x_new, false);
  for (const Anchor& h : c.anchors) largest = std::max(largest, h.rigid ? 0.0 : max_abs(h.force.total));
  return largest;
}

}  // namespace

int particle_of(const Contact& contact) { return contact.a.w0 != 0 ? contact.a.first : contact.a.first + 1; }

bool update_direct(Island& island, Contact& contact) {
  Tendon& c = island.at(contact.a);
  const int i = particle_of(contact);
  if (contact.normal_force.held) {
    // The residual at the particle is the force that the body supplies.
    contact.normal_force.value = std::max(0.0, dot(c.residual.at(i), contact.geometry.normal));
    contact.normal_force.held = contact.normal_force.value > 0;
    return !contact.normal_force.held;
  }
  contact.normal_force.value = 0;
  if (contact.geometry.gap >= 0) return false;
  contact.normal_force.held = true;
  c.move(i, (-contact.geometry.gap) * contact.geometry.normal);
  return true;
}

Assembly residual_of(Island& island, bool at_position) {
  Assembly a;
  clear_loads(island);
  clear_pulls(island);
  for (Tendon* c : island.tendons) a.scale = std::max(a.scale, tendon_residual(*c));
  for (Contact* contact : island.contacts) {
    follow(island, *contact);
    contact->evaluate(relative_position(island, *contact, &Tendon::x_new), at_position);
    if (!contact->acts()) continue;
    a.scale = std::max(a.scale, max_abs(contact->force.total));
    exert(island, *contact, contact->force.total, &Tendon::residual);
  }
  for (Tendon* c : island.tendons) read_anchor_forces(*c);
  load_carried(island, &Tendon::residual);
  load_lines(island, false);
  a.scale = std::max(a.scale, load_elements(island));
  start_body_residual(island, 1);
  return a;
}

void predict_contacts(Island& island, bool keeps_limits, bool far) {
  for (Contact* contact : island.contacts)
    contact->predict(relative_position(island, *contact, &Tendon::dx),
                     keeps_limits || (far && contact->normal_force.direct));
}

void predict_anchors(Island& island) {
  for (Tendon* c : island.tendons)
    for (Anchor& h : c->anchors)
      if (h.is_line)
        h.line.predict(c->dx.at(h.particle) - end_moved(island, h));
      else if (!h.rigid)
        h.predict(h.raw + h.slope(c->h_eff) * c->dx.at(h.particle));
}

void carry_springs(Island& island) {
  for (Tendon* c : island.tendons)
    for (SpringSet* s : {&c->structure, &c->shear})
      if (s->count) carry(*s, c->material.law, c->dx);
}

void assemble(Island& island, Linearisation how, bool definite, bool definite_contacts) {
  clear_loads(island);
  for (Tendon* c : island.tendons) {
    const double inverse = 1 / (c->h_eff * c->h_eff), floor_force = kFloorShare * c->residual_norm;
    const int most_springs = !definite ? 0 : c->shear.count > 0 ? 4 : 2;
    for (SpringSet* s : {&c->structure, &c->shear}) {
      if (s->count == 0) continue;
      linearise(*s, c->material.law, how, floor_force, c->motion(), most_springs);
      scatter_linearisation(*s, c->material.law, c->residual);
    }
    start_matrix(c->structure, c->mass, inverse, c->matrix);
    if (c->shear.count > 0) scatter_blocks(c->shear, c->matrix);
    add_bending_blocks(*c);
    add_soft_anchors(*c, c->x_new, true);
  }
  linearise_contacts(island, true, definite_contacts);
  for (const Contact* contact : island.acting)
    exert(island, *contact, contact->force.linear - contact->force.total, &Tendon::residual);
  load_carried(island, &Tendon::residual);
  load_lines(island, true);
  add_body_residual(island);
  make_border(island, definite);
  project_anchors(island, &Tendon::residual);
  fix_in_matrix(island);
}

namespace {

// The larger value; NaN is kept.
double worse(double a, double b) { return b > a || b != b ? b : a; }

// Largest stiffness of springs at the present state [N/m]. The matrix is not used: in a diverging iteration
// its stiffness is so large that any residual would be taken for rounding.
double stiffness_at_hand(Tendon& c) {
  double most = 0;
  for (SpringSet* s : {&c.structure, &c.shear})
    if (s->count) most = std::max(most, largest_stiffness(*s, c.material.law, c.h_eff));
  return 2 * most;
}

// Largest stiffness of anchors and bending, which are evaluated at rounded positions [N/m].
double stiffness_beside(const Tendon& c) {
  double most = 0;
  for (const Anchor& h : c.anchors)
    if (!h.rigid)
      most = std::max(
          {most, h.stiffness.xx, h.stiffness.yy, h.stiffness.zz, h.viscosity / c.h_eff, h.line.spring});
  if (c.material.bending_stiffness == 0) return 2 * most;
  const double rest = c.shortest_rest();
  return 2 * most + 16 * c.material.bending_stiffness / (rest * rest * rest);
}

// Force of one rounding [N]: of the coordinates at the start of the step while the displacement is the guess,
// and of the displacements after that.
double force_of_rounding(Tendon& c, double contact_stiffness, bool at_guess) {
  const double coordinate = c.x_new.largest();
  const double length = largest_of(c.structure.length.data(), c.structure.count);
  const double displacement = c.displacement.largest();
  const double fine = at_guess ? coordinate : std::max(length, displacement);
  const double springs = stiffness_at_hand(c) * std::min(fine, coordinate);
  const double inertia = largest_of(c.mass.data(), c.n()) / (c.h_eff * c.h_eff) * displacement;
  return std::numeric_limits<double>::epsilon() *
         (springs + inertia + (stiffness_beside(c) + contact_stiffness) * coordinate);
}

}  // namespace

void measure_residual(Island& island, Assembly& a) {
  project_anchors(island, &Tendon::residual);
  for (Tendon* c : island.tendons) {
    c->residual_norm = c->residual.largest();
    a.residual = worse(a.residual, c->residual_norm);
  }
  a.of_bodies = body_residual(island);
  for (const Contact* contact : island.contacts)
    if (contact->acts()) a.of_limits = worse(a.of_limits, std::fabs(contact->limit_error()));
  a.of_forces = worse(a.residual, a.of_bodies);
  a.residual = worse(a.of_forces, a.of_limits);
}

double in_roundings(Island& island, const Assembly& a, bool at_guess) {
  double contact_stiffness = 0, most = 0;
  for (const Contact* contact : island.contacts)
    if (contact->normal_force.value > 0)
      contact_stiffness = std::max(contact_stiffness, contact->normal_force.stiffness);
  // Bodies and contacts take part in the rounding of all that acts on them.
  double coarsest = island.elements.all.empty() ? 0 : element_rounding(island);
  for (Tendon* c : island.tendons) {
    const double one = force_of_rounding(*c, contact_stiffness, at_guess);
    most = worse(most, c->residual_norm / one);
    coarsest = std::max(coarsest, one);
  }
  return worse(most, worse(a.of_bodies, a.of_limits) / coarsest);
}

void find_worst(Island& island) {
  for (Tendon* c : island.tendons) {
    for (int i = c->n() - 1; i >= 0; --i)
      if (!(max_abs(c->residual.at(i)) < c->residual_norm)) c->worst_particle = i;
  }
}

Vec3 relative_position(const Island& island, const Contact& contact, Field Tendon::* where) {
  const Vec3 a = contact.a.of(island.at(contact.a).*where);
  if (contact.b.tendon >= 0) return a - contact.b.of(island.at(contact.b).*where);
  return contact.moves && where != &Tendon::x ? a - body_moved(island, contact, where != &Tendon::x_new) : a;
}

void exert(Island& island, const Contact& contact, Vec3 force, Which on) {
  pull_back(island.at(contact.a).*on, contact.a, force);
  if (contact.b.tendon >= 0) pull_back(island.at(contact.b).*on, contact.b, -force);
  if (contact.moves) load_body(island, contact, force);
}

namespace {

void ends_of(const Island& island, const Contact& contact, Vec3 (&x)[4]) {
  const Field &a = island.at(contact.a).x_new, &b = island.at(contact.b).x_new;
  x[0] = a.at(contact.a.first);
  x[1] = a.at(contact.a.first + 1);
  x[2] = b.at(contact.b.first);
  x[3] = b.at(contact.b.first + 1);
}

// Displacement of a rim from where it is foreseen to be.
Vec3 rim_moved(const Island& island, const Contact& contact) {
  if (!contact.moves) return {};
  return island.bodies.link(contact.link).displaced_from_foreseen(contact.rim_arm);
}

}  // namespace

// A round surface that rotates about its axis stays where it is, while the contact point moves with it. The
// edge of a mouth and the wall of a bore turn with their body: force and gap have one Jacobian.
void follow(Island& island, Contact& contact) {
  if (contact.is_curved()) {
    const Vec3 moved = rim_moved(island, contact);
    const Field& x = island.at(contact.a).x_new;
    if (contact.moves && contact.turns())
      contact.turn(island.bodies.link(contact.link).turned_from_foreseen());
    if (contact.follows()) contact.follow(x.at(contact.a.first) - moved, x.at(contact.a.first + 1) - moved);
    // The arm leads to the point at which the force acts, so that it turns neither the one nor the other.
    const Vec3 at = contact.a.of(x) - moved;
    const Rot3& turn = island.bodies.link(contact.link).iterate.turned.rotation;
    if (!contact.is_round() || contact.friction.coefficient > 0)
      contact.arm = contact.rim_arm + transposed_times(turn, at - contact.geometry.rim.centre);
    contact.geometry.rim_shift = contact.moves ? body_moved(island, contact, false) - moved : Vec3{};
  } else if (contact.b.tendon >= 0) {
    Vec3 x[4];
    ends_of(island, contact, x);
    contact.follow_pair(x);
  }
}

BT_VECTOR void find_matrix(const Contact& contact, const Link* link, const Vec3* turned, bool all_turn,
                           ContactMatrix& k) {
  const ContactForce& force = contact.force;
  const int particles = contact.b.tendon >= 0 ? 4 : 2;
  const double weights[4] = {contact.a.w0, contact.a.w1, -contact.b.w0, -contact.b.w1};
  const Mat3 block = full(force.block);
  for (int i = 0; i < particles; ++i)
    for (int j = i; j < particles; ++j) k.at(i, j) = (weights[i] * weights[j]) * block;
  Vec3 rim;
  if (link) {
    // A surface that does not turn with the body moves as its centre does, and so do the normal and the point
    // that slides along it.
    const Vec3 arm = link->now(contact.arm);
    rim = contact.is_curved() && !contact.turns() && !turned ? link->now(contact.rim_arm) : arm;
    const Mat3 fixed = times_cross(full(force.block + -1.0 * force.turning), arm);
    const Mat3 turning = times_cross(full(force.turning), rim);
    Mat3 all = fixed + turning;
    k.at(3, 3) = times_cross(transposed(fixed), arm) + times_cross(transposed(turning), rim);
    if (turned) {
      // The potential of a surface that turns has the further term w.(d x f), for the rotation w of the link
      // and the displacement d of a relative to it, with f on the tendon.
      // The centre of a surface that slides moves with the arm to it (load_body), by virtual work or because
      // the arm to the contact point is taken from there.
      const bool slides = contact.is_curved() && !all_turn;
      const Vec3 lever = slides ? 0.5 * (arm + link->now(contact.rim_arm)) : arm;
      const Mat3 by_turn = times_cross(full(identity(1)), force.linear), both = times_cross(by_turn, lever);
      all += by_turn;
      k.at(3, 3) = k.at(3, 3) - (both + transposed(both));
    }
    for (int i : {0, 1}) k.at(i, 3) = weights[i] * all;
  }
  for (int t = 0; t < contact.geometry.sliding_terms; ++t) {
    Vec3 l[4];
    std::copy_n(contact.geometry.sliding_term[t], particles, l);
    if (link) l[3] = cross(l[0] + l[1], rim);
    if (turned) l[3] += cross(contact.geometry.normal, *turned);
    for (int i = 0; i < 4; ++i) {
      const Vec3 p = contact.geometry.sliding_share[t] * l[i];
      for (int j = i; j < 4; ++j)
        if (std::max(i, j) < particles || (link && i != 2 && j != 2)) k.at(i, j) += outer_product(p, l[j]);
    }
  }
  if (!link) return;
  // Where all of them move alike, nothing changes.
  k.at(0, 2) = -1 * (k.at(0, 0) + k.at(0, 1));
  k.at(1, 2) = -1 * (transposed(k.at(0, 1)) + k.at(1, 1));
  k.at(2, 2) = -1 * (k.at(0, 2) + k.at(1, 2));
  k.at(2, 3) = -1 * (k.at(0, 3) + k.at(1, 3));
}

namespace {

void find_sliding_terms(const Island& island, Contact& contact, bool definite) {
  Vec3 x[4];
  const Field& a = island.at(contact.a).x_new;
  const Vec3 moved = rim_moved(island, contact);
  if (contact.follows())
    contact.add_sliding_term(a.at(contact.a.first) - moved, a.at(contact.a.first + 1) - moved, definite);
  else if (contact.b.tendon >= 0) {
    ends_of(island, contact, x);
    contact.add_pair_sliding_terms(x, definite);
  }
}

// Adds the part of a contact's matrix that is within the band of the tendon of a segment point.
void add_within_band(Band& band, int first, const ContactMatrix& k, int point) {
  for (int i : {0, 1}) band.add(first + i, upper(k.at(point + i, point + i)));
  band.add_below(first, transposed(k.at(point, point + 1)));
}

}  // namespace

void linearise_contacts(Island& island, bool slide, bool definite) {
  island.acting.clear();
  for (Contact* contact : island.contacts)
    if (contact->acts()) island.acting.push_back(contact);
  island.of_contacts.resize(std::max(island.of_contacts.size(), island.acting.size()));
  island.bodies.link_blocks.resize(island.bodies.links->size());
  for (int l : island.bodies.carried) island.bodies.link_blocks[l] = {};
  for (size_t c = 0; c < island.acting.size(); ++c) {
    Contact& contact = *island.acting[c];
    ContactMatrix& k = island.of_contacts[c];
    Tendon& a = island.at(contact.a);
    contact.linearise(definite);
    if (slide) find_sliding_terms(island, contact, definite);
    const Link* link = contact.moves ? &island.bodies.link(contact.link) : nullptr;
    const Vec3 segment = a.x_new.at(contact.a.first + 1) - a.x_new.at(contact.a.first);
    const bool turns = island.bodies.turn_surfaces || (!definite && contact.turns());
    find_matrix(contact, link, link && turns ? &segment : nullptr, island.bodies.turn_surfaces, k);
    add_within_band(a.matrix, contact.a.first, k, 0);
    if (contact.b.tendon >= 0) add_within_band(island.at(contact.b).matrix, contact.b.first, k, 2);
    if (!link) continue;
    ContactMatrix& sum = island.bodies.link_blocks[contact.link];
    for (int i : {2, 3})
      for (int j = i; j < 4; ++j) sum.at(i, j) += k.at(i, j);
  }
}

void add_soft_anchors(Tendon& c, const Field& x, bool matrix) {
  for (Anchor& h : c.anchors) {
    if (h.rigid) continue;
    if (matrix) {
      c.matrix.add(h.particle, h.block(h.slope(c.h_eff)));
      c.residual.add(h.particle, h.linearised() - h.force.total);
      continue;
    }
    h.evaluate(x.at(h.particle), c.motion().velocity(h.particle));
    c.residual.add(h.particle, h.force.total);
  }
}

void project_anchors(Island& island, Field Tendon::* what) {
  for (Tendon* c : island.tendons)
    for (const Anchor& h : c->anchors)
      if (h.rigid) (c->*what).set(h.particle, Vec3{});
  for (const Contact* contact : island.contacts) {
    if (!contact->normal_force.held) continue;
    Field& f = island.at(contact->a).*what;
    const int i = particle_of(*contact);
    f.set(i, without(f.at(i), contact->geometry.normal));
  }
}

void fix_in_matrix(Island& island) {
  for (Tendon* c : island.tendons)
    for (const Anchor& h : c->anchors)
      if (h.rigid) c->matrix.hold(h.particle, identity(1));
  for (const Contact* contact : island.contacts)
    if (contact->normal_force.held)
      island.at(contact->a).matrix.hold(particle_of(*contact), outer(contact->geometry.normal));
}

// A particle at an anchor touches nothing by itself: what it is attached to is there. Between two anchors a
// segment does, where they can part from the body.
bool overruled(const Contact& contact, const Tendon& c, const std::vector<Link>& links) {
  const bool within = contact.a.w0 > 0 && contact.a.w1 > 0;
  for (int e : {0, 1}) {
    if ((e ? contact.a.w1 : contact.a.w0) < kLeastEndWeight) continue;
    const Anchor* anchor = fixed_anchor(c, contact.a.first + e);
    if (!anchor || (within && !keep_distance(*anchor, contact.link, links))) return false;
  }
  return true;
}

bool overruled(const Contact& contact, const Tendon& a, const Tendon& b, const std::vector<Link>& links) {
  const Anchor* other = nullptr;
  for (const auto& [c, spot] : {std::pair{&a, &contact.a}, std::pair{&b, &contact.b}})
    for (int e : {0, 1}) {
      if ((e ? spot->w1 : spot->w0) < kLeastEndWeight) continue;
      const Anchor* anchor = fixed_anchor(*c, spot->first + e);
      if (!anchor || (other && !keep_distance(*anchor, *other, links))) return false;
      other = anchor;
    }
  return true;
}

void read_anchor_forces(Tendon& c) {
  // The anchor supplies the residual, and receives the opposite force.
  for (Anchor& h : c.anchors)
    if (h.rigid) h.force.total = -c.residual.at(h.particle);
}

}  // namespace bt
