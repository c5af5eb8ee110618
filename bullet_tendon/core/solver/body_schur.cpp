// Bodies as unknowns together with the particles of the tendons.
//
// With the particles x and the unknowns y of the bodies (bodies/body_response.h), the solution is stationary
// in both:
//
//   r_x = as in integrator/scheme.h, with contacts at x_a - (p + B y) and attached particles at p + B y
//   r_y = y + sum B^T (residual force of attached particles + force of the tendons' contacts on the body)
//
// Newton's matrix consists of the tendons' matrix A, a border C and a corner D. C has one column, and D one
// row and column, for each unknown of the bodies. These are few. The Schur complement needs only the factors
// of A:
//
//   (D - C^T A^-1 C) dy = -(r_y - C^T A^-1 r_x),     dx = -A^-1 (r_x + C dy).
//
// A line (tendon/line.h) is a force between a particle and a point of a body, as a contact is.
#include "solver/body_schur.h"

#include <algorithm>
#include <cmath>

#include "solver/assembly.h"
#include "solver/solver.h"

namespace bt {

namespace {

template <class Do>
void each_body(const Island& island, Do what) {
  for (int m : island.bodies.indices) what(island.bodies.body(m));
}

// Of an anchor: Anchor::carries or Anchor::pulls.
using IsMeant = bool (Anchor::*)() const;

// Calls what(tendon, anchor, link, arm) of the anchors that are meant.
template <class Do>
void each_anchor(const Island& island, IsMeant is_meant, Do what) {
  for (Tendon* c : island.tendons)
    for (Anchor& h : c->anchors)
      if ((h.*is_meant)()) {
        Link& link = island.bodies.link(h.link);
        what(*c, h, link, link.held_arm_of(h.local));
      }
}

// turning: the part of the arm that turns with the body.
void add_load(Link& link, Vec3 force, Vec3 arm, Vec3 turning) {
  const Vec3 torque = cross(link.now(arm), force);
  link.iterate.load.force += force;
  link.iterate.load.torque += torque;
  if (link.iterate.turned.far) link.iterate.turned.add_pull(link.now(turning), force, torque);
}

// Adds B^T of the loads on links to the vectors of their bodies.
template <class Numbers>
void add_generalized_loads(const Island& island, Numbers numbers_of) {
  for (int l : island.bodies.carried) {
    const Link& link = island.bodies.link(l);
    link.add_generalized(link.iterate.reached, island.bodies.reach * link.iterate.load,
                         numbers_of(link.body));
  }
}

// Sets the steps of the carried particles to those of their links.
void carry_steps(Island& island, Which steps) {
  each_anchor(island, &Anchor::carries, [&](Tendon& c, const Anchor& h, Link& link, Vec3 arm) {
    (c.*steps).set(h.particle, link.stepped(arm));
  });
}

void place(Island& island) {
  for (int l : island.bodies.carried) {
    Link& link = island.bodies.link(l);
    const GeneralizedBody& m = island.bodies.body(link.body);
    link.iterate.given = island.bodies.reach * link.spin_of(m.unknowns.y);
    if (link.iterate.turned.far) link.turn(m);
  }
  each_anchor(island, &Anchor::carries, [](Tendon& c, const Anchor& h, Link& link, Vec3 arm) {
    c.place(h.particle, h.target.aim);
    c.move(h.particle, link.displaced(arm));
  });
  each_anchor(island, &Anchor::pulls, [](Tendon&, Anchor& h, Link& link, Vec3 arm) {
    h.line.end = h.target.aim + link.displaced(arm);
  });
}

// The last generalized forces are the first guess.
void guess(const Island& island, GeneralizedBody& m) {
  m.unknowns.y.assign(m.n(), 0.0);
  m.unknowns.dy.assign(m.n(), 0.0);
  m.unknowns.residual.assign(m.n(), 0.0);
  if (!m.knows_last_forces()) return;
  m.answer_last_forces(m.unknowns.y);
  for (double& v : m.unknowns.y) v *= island.bodies.reach;
}

}  // namespace

void start_bodies(Island& island) {
  if (island.bodies.indices.empty()) return;
  each_body(island, [](GeneralizedBody& m) { m.unknowns.lever = 0; });
  auto reach_to = [&](Link& link, Vec3 arm) {
    double& lever = island.bodies.body(link.body).unknowns.lever;
    lever = std::max(lever, island.bodies.reach * std::sqrt(trace(link.mobility(link.centre + arm))));
  };
  for (const IsMeant is_meant : {&Anchor::carries, &Anchor::pulls})
    each_anchor(island, is_meant, [&](Tendon&, const Anchor&, Link& link, Vec3 arm) { reach_to(link, arm); });
  for (const Contact* contact : island.contacts)
    if (contact->moves) reach_to(island.bodies.link(contact->link), contact->touched_arm());
  for (const Element* element : island.elements.all)
    for (const TouchedLink& touched : element->touched()) {
      Link& link = island.bodies.link(touched.link);
      if (link.yields()) reach_to(link, touched.lever);
    }
  each_body(island, [&](GeneralizedBody& m) {
    // Where contacts were detected again, the last solution of the substep is kept.
    if (static_cast<int>(m.unknowns.y.size()) != m.n()) guess(island, m);
  });
  place(island);
}

void put_bodies_aside(Island& island) {
  each_body(island, [](GeneralizedBody& m) {
    m.unknowns.dy = m.unknowns.y;
    m.unknowns.y.assign(m.n(), 0.0);
  });
}

double body_potential(const Island& island) {
  double sum = 0;
  each_body(island, [&](const GeneralizedBody& m) { sum += 0.5 * dense::dot(m.unknowns.y, m.unknowns.y); });
  return sum;
}

void place_bodies(Island& island) {
  if (!island.bodies.indices.empty()) place(island);
}

void advance_bodies(Island& island, double alpha, double second) {
  if (island.bodies.indices.empty()) return;
  each_body(island, [&](GeneralizedBody& m) {
    dense::add(m.unknowns.y, alpha, m.unknowns.dy);
    if (second != 0) dense::add(m.unknowns.y, second, m.unknowns.correction);
  });
  place(island);
}

void move_bodies(Island& island, double share, Which x, dense::Numbers BodyUnknowns::* change) {
  if (island.bodies.indices.empty()) return;
  each_body(island, [&](GeneralizedBody& m) {
    dense::Numbers& of = m.unknowns.*change;
    of.resize(m.n());
    for (int k = 0; k < m.n(); ++k) of[k] = share * island.bodies.corner_side[m.unknowns.first + k];
  });
  for (int l : island.bodies.carried) {
    Link& link = island.bodies.link(l);
    link.iterate.stepped =
        island.bodies.reach * link.twist_of(island.bodies.body(link.body).unknowns.*change);
  }
  carry_steps(island, x);
}

Vec3 body_moved(const Island& island, const Contact& contact, bool by_step) {
  const Link& link = island.bodies.link(contact.link);
  return by_step ? link.stepped(contact.arm) : link.displaced_from_foreseen(contact.arm);
}

Vec3 end_moved(const Island& island, const Anchor& line) {
  if (!line.pulls()) return {};
  const Link& link = island.bodies.link(line.link);
  return link.stepped(link.held_arm_of(line.local));
}

void clear_loads(Island& island) {
  for (int l : island.bodies.carried) island.bodies.link(l).iterate.load = {};
}

void clear_pulls(Island& island) {
  for (int l : island.bodies.carried) island.bodies.link(l).iterate.turned.pulls = {};
}

// The point of a contact slides on a curved surface. Where the surface itself does not turn, the tendon holds
// this point in place while the body turns. With an arm that turned with the body, a tendon that is wound
// around a free wheel would seem to turn it on: the matrix would not be definite.
void load_body(Island& island, const Contact& contact, Vec3 force) {
  const bool slides = contact.is_curved() && !island.bodies.turn_surfaces;
  add_load(island.bodies.link(contact.link), force, contact.arm, slides ? contact.rim_arm : contact.arm);
}

void load_carried(Island& island, Which forces) {
  each_anchor(island, &Anchor::carries, [&](Tendon& c, const Anchor& h, Link& link, Vec3 arm) {
    add_load(link, (c.*forces).at(h.particle), arm, arm);
    (c.*forces).set(h.particle, {});  // it is a force on the link now
  });
}

void load_lines(Island& island, bool beyond) {
  each_anchor(island, &Anchor::pulls, [beyond](Tendon&, const Anchor& h, Link& link, Vec3 arm) {
    add_load(link, beyond ? h.force.total - h.linearised() : -h.force.total, arm, arm);
  });
}

void start_body_residual(Island& island, double share) {
  each_body(island, [share](GeneralizedBody& m) {
    for (int k = 0; k < m.n(); ++k) m.unknowns.residual[k] = share * m.unknowns.y[k];
  });
  add_body_residual(island);
}

void add_body_residual(Island& island) {
  add_generalized_loads(island,
                        [&](int m) -> dense::Numbers& { return island.bodies.body(m).unknowns.residual; });
}

bool bodies_are_overpowered(const Island& island, const Substepper& substeps) {
  static thread_local dense::Numbers forces;  // keeps its memory from step to step
  return std::any_of(island.bodies.indices.begin(), island.bodies.indices.end(), [&](int body) {
    GeneralizedBody& m = island.bodies.body(body);
    if (!m.stops.motors.any()) return false;
    forces.assign(m.n(), 0.0);
    for (int l : island.bodies.carried)
      if (const Link& link = island.bodies.link(l); link.body == body)
        link.add_generalized(link.jacobian, -substeps.h() * link.iterate.load, forces);
    dense::add(forces, 1, m.substep.pushed);
    for (double& f : forces) f /= substeps.end();
    return m.overpowered(forces, substeps.step());
  });
}

bool contacts_lock_bodies(const Island& island, double ratio) {
  static thread_local dense::Numbers together, one;  // keep their memory from step to step
  return std::any_of(island.bodies.indices.begin(), island.bodies.indices.end(), [&](int body) {
    double sum = 0;
    together.assign(island.bodies.body(body).n(), 0.0);
    for (const Contact* contact : island.contacts) {
      if (!contact->moves || island.bodies.link(contact->link).body != body) continue;
      const Link& link = island.bodies.link(contact->link);
      auto push = [&](Vec3 force, dense::Numbers& to) {
        link.add_generalized(link.root, {force, link.torque_of(force, contact->arm)}, to);
      };
      one.assign(together.size(), 0.0);
      push(contact->normal_force.value * contact->geometry.normal, one);
      sum += std::sqrt(dense::dot(one, one));
      push(contact->force.total, together);
    }
    return sum > ratio * std::sqrt(dense::dot(together, together));
  });
}

double body_residual(const Island& island) {
  double most = 0;
  each_body(island, [&](const GeneralizedBody& m) {
    const double size = std::sqrt(dense::dot(m.unknowns.residual, m.unknowns.residual));
    const double force = m.unknowns.lever > 0 ? size / m.unknowns.lever : 0 * size;
    if (!(force <= most)) most = force;
  });
  return most;
}

// Of all wrenches on the touched links of a body that give its residual r, sum B^T w = r, the smallest:
// w = B (sum B^T B)^-1 r.
void correct_wrenches(Island& island) {
  for (int body : island.bodies.indices) {
    const GeneralizedBody& m = island.bodies.body(body);
    const int n = m.n();
    dense::Numbers square(n * n), factor, part = m.unknowns.residual;
    auto each_link = [&](auto what) {
      for (int l : island.bodies.carried)
        if (Link& link = island.bodies.link(l); link.body == body) what(link);
    };
    each_link([&](const Link& link) {
      for (int row = 0; row < 6; ++row)
        for (int i = 0; i < n; ++i)
          for (int j = 0; j < n; ++j) square[i * n + j] += link.root[row * n + i] * link.root[row * n + j];
    });
    dense::root(n, square, factor);
    dense::solve(factor, part);
    each_link([&](Link& link) {
      const Twist by = (1 / island.bodies.reach) * link.spin_of(part);
      link.correction = {by.linear, by.angular};
    });
  }
}

double body_slope(const Island& island, double second) {
  double sum = 0;
  each_body(island, [&](const GeneralizedBody& m) {
    sum += dense::dot(m.unknowns.residual, m.unknowns.dy);
    if (second != 0) sum += second * dense::dot(m.unknowns.residual, m.unknowns.correction);
  });
  return sum;
}

namespace {

// The border and the corner of Newton's matrix, for eight unknowns of bodies at once.
//
// An unknown moves the links of its body and the particles that these carry. Its column of the border is the
// derivative of the forces on the tendons. Its column of the corner is B^T of the derivative of the loads on
// the links.

// Displacement u at the arm r from the centre of the twist.
BT_WITHIN inline void place_at(const Eight* twist, Vec3 r, Eight* u) {
  u[0] = twist[0] + (r.z * twist[4] - r.y * twist[5]);
  u[1] = twist[1] + (r.x * twist[5] - r.z * twist[3]);
  u[2] = twist[2] + (r.y * twist[3] - r.x * twist[4]);
}

BT_WITHIN inline void add_force(Eight* load, const Eight* f, Vec3 r) {
  for (int c = 0; c < 3; ++c) load[c] += f[c];
  load[3] += r.y * f[2] - r.z * f[1];
  load[4] += r.z * f[0] - r.x * f[2];
  load[5] += r.x * f[1] - r.y * f[0];
}

// to += b v
BT_WITHIN inline void add(Eight* to, const Mat3& b, const Eight* v) {
  auto along = [v](Vec3 row) BT_WITHIN { return row.x * v[0] + row.y * v[1] + row.z * v[2]; };
  to[0] += along(b.r0);
  to[1] += along(b.r1);
  to[2] += along(b.r2);
}

// Adds the forces of the band on particle i and its neighbours, due to the displacement of particle i.
BT_WITHIN inline void move_particle(const Band& a, int i, Panel& panel) {
  const Eight* u = panel.moves.at(i);
  auto add_entry = [&](int j, int r, int c, double entry) BT_WITHIN { panel.pulls.at(j)[r] += entry * u[c]; };
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      add_entry(i, r, c, a.diagonal[kFull[3 * r + c]][i]);
      for (int o = 1; o <= a.half; ++o) {
        if (i + o < a.n) add_entry(i + o, r, c, a.below[o - 1][3 * r + c][i]);
        if (i >= o) add_entry(i - o, r, c, a.below[o - 1][3 * c + r][i - o]);
      }
    }
}

// As each_anchor, of these tendons, with the border of the tendon, and the arm at the end of the substep:
// what(tendon, border, anchor, arm).
template <class Do>
BT_WITHIN inline void each_column(Island& island, const std::vector<int>& tendons, IsMeant is_meant,
                                  Do what) {
  for (int k : tendons)
    for (const Anchor& h : island.tendons[k]->anchors)
      if ((h.*is_meant)()) {
        const Link& link = island.bodies.link(h.link);
        what(*island.tendons[k], island.bodies.borders[k], h, link.now(link.held_arm_of(h.local)));
      }
}

// The border of the tendon of a segment point.
Border& border_of(Island& island, const SegmentPoint& s) {
  return island.bodies.borders[island.bodies.place_of[s.tendon]];
}

// Of a particle, in Border::marks.
enum Mark : char { kPulled = 1, kCarried = 2 };

void mark(Border& border, const Tendon& c, int first, int last) {
  first = std::max(0, first);
  last = std::min(c.n() - 1, last);
  for (int i = first; i <= last; ++i) border.marks[i] |= kPulled;
  border.first = std::min(border.first, first);
  border.last = std::max(border.last, last);
}

void mark(Island& island, const SegmentPoint& s) {
  mark(border_of(island, s), island.at(s), s.first, s.first + 1);
}

void list_marks(Border& border) {
  border.pulled.clear();
  for (int i = border.first; i <= border.last; ++i)
    if (border.marks[i]) border.pulled.push_back(i);
}

// Finds the particles of every tendon on which the unknowns of bodies act.
void find_spans(Island& island) {
  island.bodies.borders.resize(island.tendons.size());
  island.bodies.place_of.resize(island.slots->size());
  for (size_t k = 0; k < island.tendons.size(); ++k) {
    const Tendon& c = *island.tendons[k];
    island.bodies.place_of[island.numbers[k]] = static_cast<int>(k);
    Border& border = island.bodies.borders[k];
    border.marks.assign(c.n(), 0);
    border.carried = false;
    border.first = c.n();
    border.last = -1;
    for (const Anchor& h : c.anchors) {
      if (h.pulls()) mark(border, c, h.particle, h.particle);
      if (!h.carries()) continue;
      border.carried = true;
      border.marks[h.particle] |= kCarried;
      mark(border, c, h.particle - c.matrix.half, h.particle + c.matrix.half);
    }
  }
  for (const Contact* contact : island.acting) {
    if (contact->moves) mark(island, contact->a);
    if (contact->b.tendon < 0) continue;
    if (border_of(island, contact->b).carried) mark(island, contact->a);
    if (border_of(island, contact->a).carried) mark(island, contact->b);
  }
  for (Border& border : island.bodies.borders) list_marks(border);
}

// What acts on what, in an island.
struct Graph {
  std::vector<std::vector<int>> tendons;                    // by link
  std::vector<std::vector<int>> links, partners, contacts;  // by tendon; contacts: of its segments
};

void connect(const Island& island, Graph& graph) {
  const size_t tendons = island.tendons.size(), links = island.bodies.links->size();
  graph.tendons.resize(std::max(links, graph.tendons.size()));
  for (int l : island.bodies.carried) graph.tendons[l].clear();
  for (auto* by_tendon : {&graph.links, &graph.partners, &graph.contacts}) {
    by_tendon->resize(std::max(tendons, by_tendon->size()));
    for (size_t k = 0; k < tendons; ++k) (*by_tendon)[k].clear();
  }
  auto join = [&](int tendon, int link) {
    graph.tendons[link].push_back(tendon);
    graph.links[tendon].push_back(link);
  };
  for (size_t k = 0; k < tendons; ++k)
    for (const Anchor& h : island.tendons[k]->anchors)
      if (h.carries() || h.pulls()) join(static_cast<int>(k), h.link);
  for (size_t c = 0; c < island.acting.size(); ++c) {
    const Contact& contact = *island.acting[c];
    const int a = island.bodies.place_of[contact.a.tendon];
    graph.contacts[a].push_back(static_cast<int>(c));
    if (contact.moves) join(a, contact.link);
    if (contact.b.tendon < 0) continue;
    const int b = island.bodies.place_of[contact.b.tendon];
    graph.partners[a].push_back(b);
    graph.partners[b].push_back(a);
  }
}

// Adds what these ones have in a graph. In order, each once.
void add_joined(std::vector<int>& to, const std::vector<std::vector<int>>& graph,
                const std::vector<int>& of) {
  for (int i : of) to.insert(to.end(), graph[i].begin(), graph[i].end());
  std::sort(to.begin(), to.end());
  to.erase(std::unique(to.begin(), to.end()), to.end());
}

// Finds what each panel acts on, by the links of its bodies.
void find_reaches(Island& island) {
  static thread_local Graph graph;  // keeps its memory
  connect(island, graph);
  std::vector<PanelReach>& reaches = island.bodies.reaches;
  reaches.resize((island.bodies.freedom + kLanes - 1) / kLanes);
  for (PanelReach& reach : reaches)
    for (auto* list : {&reach.moved, &reach.tendons, &reach.links, &reach.contacts}) list->clear();
  for (int l : island.bodies.carried) {
    const GeneralizedBody& m = island.bodies.body(island.bodies.link(l).body);
    for (int p = m.unknowns.first / kLanes; p * kLanes < m.unknowns.first + m.n(); ++p)
      reaches[p].moved.push_back(l);
  }
  for (PanelReach& reach : reaches) {
    reach.links = reach.moved;
    add_joined(reach.tendons, graph.tendons, reach.moved);
    add_joined(reach.tendons, graph.partners, std::vector<int>(reach.tendons));
    add_joined(reach.links, graph.links, reach.tendons);
    add_joined(reach.contacts, graph.contacts, reach.tendons);
  }
}

// Makes the columns of a panel zero, where they are not.
void start_panel(Panel& panel) {
  auto clear = [&](Columns& columns, bool& any) {
    if (any)
      for (int i : panel.pulled) columns.zero(i, i);
    any = false;
  };
  clear(panel.pulls, panel.pulls_any);
  clear(panel.moves, panel.moves_any);
}

void start_panels(Island& island, size_t p) {
  for (Border& border : island.bodies.borders) {
    if (border.panels.size() <= p) border.panels.resize(p + 1);
    start_panel(border.panels[p]);
  }
  for (int k : island.bodies.reaches[p].tendons) {
    Panel& panel = island.bodies.borders[k].panels[p];
    for (Columns* columns : {&panel.pulls, &panel.moves})
      if (!columns->fits(island.tendons[k]->n())) columns->resize(island.tendons[k]->n());
  }
}

// Sets the twists of links by the unknowns from `column` on.
void move_links(Island& island, const PanelReach& reach, int column) {
  island.bodies.of_links.resize(island.bodies.links->size());
  for (int l : reach.links) island.bodies.of_links[l] = {};
  for (int l : reach.moved) {
    const Link& link = island.bodies.link(l);
    const GeneralizedBody& m = island.bodies.body(link.body);
    LinkColumns& of = island.bodies.of_links[l];
    for (int k = 0; k < m.n(); ++k) {
      const int lane = m.unknowns.first + k - column;
      if (lane < 0 || lane >= kLanes) continue;
      of.moves = true;
      for (int r = 0; r < 6; ++r)
        of.twist[r][lane] = island.bodies.reach * link.iterate.reached[r * m.n() + k];
    }
  }
}

BT_VECTOR void move_carried(Island& island, size_t p) {
  const std::vector<int>& near = island.bodies.reaches[p].tendons;
  each_column(island, near, &Anchor::carries,
              [&](Tendon& c, Border& border, const Anchor& h, Vec3 arm) BT_WITHIN {
                if (!island.bodies.of_links[h.link].moves) return;
                Panel& panel = border.panels[p];
                panel.moves_any = panel.pulls_any = true;
                place_at(island.bodies.of_links[h.link].twist, arm, panel.moves.at(h.particle));
                move_particle(c.matrix, h.particle, panel);
              });
}

// The coupling of a segment with another one, or with a link, by the blocks of a contact's matrix outside the
// bands: by what moves, of columns that are not zero.
struct Coupled {
  Eight *moves[2], *pulls[2];
  bool any;
};

BT_WITHIN inline Coupled coupled(const Border& border, Panel& panel, int first) {
  if (panel.moves.empty()) return {};  // beyond the reach of the panel
  return {{panel.moves.at(first), panel.moves.at(first + 1)},
          {panel.pulls.at(first), panel.pulls.at(first + 1)},
          panel.moves_any && ((border.marks[first] | border.marks[first + 1]) & kCarried) != 0};
}

BT_VECTOR void couple_contacts(Island& island, size_t p) {
  const PanelReach& reach = island.bodies.reaches[p];
  for (int c : reach.contacts) {
    const Contact& contact = *island.acting[c];
    const bool pair = contact.b.tendon >= 0;
    if (!pair && !contact.moves) continue;
    const ContactMatrix& k = island.of_contacts[c];
    Border& border = border_of(island, contact.a);
    Panel& panel = border.panels[p];
    const Coupled a = coupled(border, panel, contact.a.first);
    Coupled b;
    if (pair) {
      Border& other = border_of(island, contact.b);
      b = coupled(other, other.panels[p], contact.b.first);
      other.panels[p].pulls_any |= a.any;
    } else {
      LinkColumns& link = island.bodies.of_links[contact.link];
      b = {{link.twist, link.twist + 3}, {link.load, link.load + 3}, link.moves};
      link.loaded |= a.any;
    }
    panel.pulls_any |= b.any;
    if (!a.any && !b.any) continue;
    for (int i : {0, 1})
      for (int j : {0, 1}) {
        if (b.any) add(a.pulls[i], k.at(i, 2 + j), b.moves[j]);
        if (a.any) add(b.pulls[j], transposed(k.at(i, 2 + j)), a.moves[i]);
      }
  }
  for (int l : reach.moved) {
    LinkColumns& link = island.bodies.of_links[l];
    if (!link.moves) continue;
    const ContactMatrix& k = island.bodies.link_blocks[l];
    link.loaded = true;
    add(link.load, k.at(2, 2), link.twist);
    add(link.load, k.at(2, 3), link.twist + 3);
    add(link.load + 3, transposed(k.at(2, 3)), link.twist);
    add(link.load + 3, k.at(3, 3), link.twist + 3);
  }
  each_column(island, reach.tendons, &Anchor::carries,
              [&](Tendon&, Border& border, const Anchor& h, Vec3 arm) BT_WITHIN {
                if (!border.panels[p].pulls_any) return;
                island.bodies.of_links[h.link].loaded = true;
                add_force(island.bodies.of_links[h.link].load, border.panels[p].pulls.at(h.particle), arm);
              });
}

BT_VECTOR void couple_lines(Island& island, size_t p) {
  const std::vector<int>& near = island.bodies.reaches[p].tendons;
  each_column(island, near, &Anchor::pulls,
              [&](Tendon&, Border& border, const Anchor& h, Vec3 arm) BT_WITHIN {
                LinkColumns& link = island.bodies.of_links[h.link];
                if (!link.moves) return;
                Eight end[3], force[3] = {};
                place_at(link.twist, arm, end);
                add(force, full(h.line.block()), end);
                border.panels[p].pulls_any = link.loaded = true;
                for (int c = 0; c < 3; ++c) border.panels[p].pulls.at(h.particle)[c] -= force[c];
                add_force(link.load, force, arm);
              });
}

// Adds the columns from `column` on to the corner, from the loads on links.
BT_VECTOR void fill_corner(Island& island, const PanelReach& reach, int column) {
  const int n = island.bodies.freedom, count = std::min(kLanes, n - column);
  for (int l : reach.links) {
    const Link& link = island.bodies.link(l);
    const GeneralizedBody& m = island.bodies.body(link.body);
    if (!island.bodies.of_links[l].loaded) continue;
    for (int i = 0; i < m.n(); ++i) {
      Eight sum{};
      for (int r = 0; r < 6; ++r)
        sum +=
            (island.bodies.reach * link.iterate.reached[r * m.n() + i]) * island.bodies.of_links[l].load[r];
      double* to = &island.bodies.corner[static_cast<size_t>(m.unknowns.first + i) * n + column];
      for (int j = 0; j < count; ++j) to[j] += sum[j];
    }
  }
}

// Adds the derivative of the torques on bodies that turn far, by their rotation, to the corner. definite:
// only its positive part.
void stiffen_turned(Island& island, bool definite) {
  const int n = island.bodies.freedom;
  for (int l : island.bodies.carried) {
    const Link& link = island.bodies.link(l);
    if (!link.iterate.turned.far) continue;
    const GeneralizedBody& m = island.bodies.body(link.body);
    const double reach = island.bodies.reach;
    const Sym3 of_turning = link.iterate.turned.stiffness();
    const Sym3 k = (reach * reach) * (definite ? positive_part(of_turning) : of_turning);
    auto spin = [&](int i) {
      return Vec3{link.root[3 * m.n() + i], link.root[4 * m.n() + i], link.root[5 * m.n() + i]};
    };
    for (int i = 0; i < m.n(); ++i)
      for (int j = 0; j < m.n(); ++j)
        island.bodies.corner[static_cast<size_t>(m.unknowns.first + i) * n + m.unknowns.first + j] +=
            dot(spin(i), k * spin(j));
  }
}

void project_anchors(Island& island, size_t p) {
  for (int k : island.bodies.reaches[p].tendons)
    for (const Anchor& h : island.tendons[k]->anchors)
      if (h.rigid) island.bodies.borders[k].panels[p].pulls.zero(h.particle, h.particle);
  for (int c : island.bodies.reaches[p].contacts) {
    const Contact* contact = island.acting[c];
    if (!contact->normal_force.held) continue;
    Eight* f = border_of(island, contact->a).panels[p].pulls.at(particle_of(*contact));
    const Eight along = contact->geometry.normal.x * f[0] + contact->geometry.normal.y * f[1] +
                        contact->geometry.normal.z * f[2];
    f[0] -= along * contact->geometry.normal.x;
    f[1] -= along * contact->geometry.normal.y;
    f[2] -= along * contact->geometry.normal.z;
  }
}

}  // namespace

void make_border(Island& island, bool definite) {
  if (island.bodies.indices.empty()) return;
  const int n = island.bodies.freedom;
  island.bodies.corner.assign(static_cast<size_t>(n) * n, 0.0);
  for (int k = 0; k < n; ++k) island.bodies.corner[k * n + k] = 1;
  stiffen_turned(island, definite);
  stiffen_by_elements(island, definite);
  find_spans(island);
  find_reaches(island);
  for (size_t p = 0; p < island.bodies.reaches.size(); ++p) {
    const PanelReach& reach = island.bodies.reaches[p];
    const int column = static_cast<int>(p) * kLanes;
    start_panels(island, p);
    move_links(island, reach, column);
    move_carried(island, p);
    couple_contacts(island, p);
    couple_lines(island, p);
    fill_corner(island, reach, column);
    project_anchors(island, p);
    for (int k : reach.tendons) island.bodies.borders[k].panels[p].pulled = island.bodies.borders[k].pulled;
  }
}

namespace {

// The Schur complement of the tendons, by the columns of the border and A^-1 times these columns.

int first_of(size_t panel) { return static_cast<int>(panel) * kLanes; }

int count_of(const Island& island, size_t panel) {
  return std::min(kLanes, island.bodies.freedom - first_of(panel));
}

// C^T A^-1 C, with the columns of panel p and the rows of panel q. Returns whether it may be other than zero.
BT_VECTOR bool multiply_answers(const Island& island, size_t p, size_t q, Eight* out) {
  Eight sums[kLanes] = {};
  bool any = false;
  for (int k : island.bodies.reaches[q].tendons) {
    const Border& border = island.bodies.borders[k];
    if (!border.panels[q].pulls_any || !border.panels[p].answered) continue;
    any = true;
    for (int i : border.pulled)
      for (int c = 0; c < 3; ++c) {
        const Eight pull = border.panels[q].pulls.at(i)[c], answer = border.panels[p].answers.at(i)[c];
        for (int a = 0; a < kLanes; ++a) sums[a] += pull[a] * answer;
      }
  }
  std::copy(sums, sums + kLanes, out);
  return any;
}

// sum += C^T x, of the columns of panel p.
BT_VECTOR void multiply_steps(const Island& island, size_t p, Which x, Eight& sum) {
  for (int k : island.bodies.reaches[p].tendons) {
    const Border& border = island.bodies.borders[k];
    if (!border.panels[p].pulls_any) continue;
    for (int i : border.pulled)
      for (int c = 0; c < 3; ++c) sum += (island.tendons[k]->*x)[c][i] * border.panels[p].pulls.at(i)[c];
  }
}

// Subtracts panel p's columns times `shares` from a tendon's column.
BT_VECTOR void take_pulls(const Border& border, size_t p, const Eight& shares, Field& from) {
  if (!border.panels[p].pulls_any) return;
  for (int i : border.pulled)
    for (int c = 0; c < 3; ++c) {
      const Eight all = shares * border.panels[p].pulls.at(i)[c];
      double sum = 0;
      for (int j = 0; j < kLanes; ++j) sum += all[j];
      from[c][i] -= sum;
    }
}

}  // namespace

void take_column(Island& island, size_t p, int lane) {
  for (Tendon* c : island.tendons) c->column.zero();
  for (int k : island.bodies.reaches[p].tendons)
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < island.tendons[k]->n(); ++i)
        island.tendons[k]->column[c][i] = island.bodies.borders[k].panels[p].pulls.at(i)[c][lane];
}

void put_answer(Island& island, size_t p, int lane) {
  for (size_t k = 0; k < island.tendons.size(); ++k)
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < island.tendons[k]->n(); ++i)
        island.bodies.borders[k].panels[p].answers.at(i)[c][lane] = island.tendons[k]->solved[c][i];
}

void take_complement(Island& island, size_t p, size_t q) {
  Eight sums[kLanes];
  if (!multiply_answers(island, p, q, sums)) return;
  auto entry = [&](int i, int j) -> double& {
    return island.bodies.corner[static_cast<size_t>(i) * island.bodies.freedom + j];
  };
  for (int a = 0; a < count_of(island, q); ++a)
    for (int j = 0; j < count_of(island, p); ++j) {
      const int contact = first_of(q) + a, column = first_of(p) + j;
      entry(contact, column) -= sums[a][j];
      if (p != q) entry(column, contact) = entry(contact, column);
    }
}

void take_steps(Island& island, size_t p, Which x) {
  Eight sum{};
  multiply_steps(island, p, x, sum);
  for (int j = 0; j < count_of(island, p); ++j) island.bodies.corner_side[first_of(p) + j] -= sum[j];
}

void answer_bodies(Island& island, Which b) {
  if (b != &Tendon::column) combine(island, 1, b, 0, &Tendon::column);
  for (size_t p = 0; first_of(p) < island.bodies.freedom; ++p) {
    Eight shares{};
    for (int j = 0; j < count_of(island, p); ++j) shares[j] = island.bodies.corner_side[first_of(p) + j];
    for (int k : island.bodies.reaches[p].tendons)
      take_pulls(island.bodies.borders[k], p, shares, island.tendons[k]->column);
  }
}

}  // namespace bt
