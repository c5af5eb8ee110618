// Links that move by themselves, or not at all, as pybullet tells of them.
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "told.h"

namespace bt {

// The frame of the URDF is the inertial one by the inverse of its local pose. Of bodies with maximal
// coordinates (body type 1) pybullet does not know that, and gives what was in memory: there both are one.
void place(Link& l, PyObject* info, PyObject* where) {
  PyObject *centre = item(where, 0), *turn = item(where, 1);
  const bool maximal = number(info, 10) == 1;
  const Rot3 local = maximal ? Rot3{} : turn_of(item(info, 4));
  l.pose.rotation = turn_of(turn) * transposed(local);
  l.centre = vector(centre);
  l.pose.origin = l.centre - (maximal ? Vec3{} : l.pose.rotation * vector(item(info, 3)));
}

void make_link(World& w, int slot) {
  if (slot < static_cast<int>(w.links.size())) return;
  w.links.resize(slot + 1), w.movers.resize(slot + 1);
}

void stand_still(World& w, int slot) {
  w.links[slot].mover = -1;
  w.links[slot].jacobian.clear();
  if (w.movers[slot].n() > 0) w.movers[slot] = Mover{};
}

bool told_well(const World& w, int slot) {
  const Link& l = w.links[slot];
  const Vec3 sum = l.pose.origin + l.centre + l.now_velocity + l.now_spin + l.pose.rotation.r0 +
                   l.pose.rotation.r1 + l.pose.rotation.r2;
  bool well = max_abs(0 * sum) == 0;
  for (const dense::Numbers* numbers : {&w.movers[slot].rates, &w.movers[slot].free})
    for (double v : *numbers) well &= std::fabs(v) <= std::numeric_limits<double>::max();
  return well;
}

namespace {

// A rigid body by itself: inverse mass, and inverse inertia in world axes, zero where it has none.
void stand_alone(Mover& m, const Link& l, PyObject* info, PyObject* turn, bool falls) {
  const Vec3 v = l.now_velocity, w = l.now_spin, inertia = vector(item(info, 2));
  m.rates.assign({v.x, v.y, v.z, w.x, w.y, w.z});
  m.limits.clear();
  m.falls.clear();
  if (falls) m.falls.assign({1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  auto inverse = [](double moment) { return moment > 0 ? 1 / moment : 0; };
  const Rot3 axes = transposed(turn_of(turn));
  const Sym3 turning = inverse(inertia.x) * outer(axes.r0) + inverse(inertia.y) * outer(axes.r1) +
                       inverse(inertia.z) * outer(axes.r2);
  const double a[3][3] = {{turning.xx, turning.xy, turning.xz},
                          {turning.xy, turning.yy, turning.yz},
                          {turning.xz, turning.yz, turning.zz}};
  m.free.assign(36, 0.0);
  for (int i = 0; i < 3; ++i) {
    m.free[7 * i] = 1 / number(info, 0);
    for (int j = 0; j < 3; ++j) m.free[6 * (3 + i) + 3 + j] = a[i][j];
  }
}

std::vector<double> place_of(const py::tuple& where) {
  PyObject *centre = item(where.ptr(), 0), *turn = item(where.ptr(), 1);
  return {number(centre, 0), number(centre, 1), number(centre, 2), number(turn, 0),
          number(turn, 1),   number(turn, 2),   number(turn, 3)};
}

// A link by p.getDynamicsInfo, (centre of mass, orientation of the inertial frame) and (velocity, spin);
// alone: it moves by itself, by its own mass, where it has one; falls: gravity makes it. 0: some number is
// not finite; 2: contacts could tell more; 3: so they could, but those that were told last can be believed
// once more, if what it rests on is still there; else 1.
int tell_link(World& w, int slot, const py::tuple& info, const py::tuple& where, const py::tuple& motion,
              bool alone, bool falls) {
  make_link(w, slot);
  Link& l = w.links[slot];
  place(l, info.ptr(), where.ptr());
  l.now_velocity = vector(item(motion.ptr(), 0)), l.now_spin = vector(item(motion.ptr(), 1));
  if (!alone || !(number(info.ptr(), 0) > 0)) return stand_still(w, slot), told_well(w, slot) ? 1 : 0;
  l.mover = slot;
  l.jacobian.clear();
  stand_alone(w.movers[slot], l, info.ptr(), item(where.ptr(), 1), falls);
  if (!told_well(w, slot)) return 0;
  if (falls && w.movers[slot].may_rest(w.gravity()))
    return w.movers[slot].contacts_stand(place_of(where), w.movers[slot].rates) ? 3 : 2;
  if (!w.movers[slot].contacts_kept) w.movers[slot].forget_contacts();
  return 1;
}

// Its velocity and spin right after a step; whether it seems to have been let go.
bool note_link(World& w, int slot, const py::tuple& motion) {
  const Vec3 v = vector(item(motion.ptr(), 0)), s = vector(item(motion.ptr(), 1));
  return w.note(slot, {v.x, v.y, v.z, s.x, s.y, s.z});
}

bool may_rest(const World& w, int slot) {
  return slot < static_cast<int>(w.movers.size()) && w.movers[slot].n() > 0 &&
         w.movers[slot].may_rest(w.gravity());
}

// Those that it has, or that are told next, are the ones of the step to come.
void keep_contacts(World& w, int slot) { w.movers[slot].contacts_kept = true; }

using Links = std::vector<std::pair<int, int>>;

// By p.getContactPoints, those with the links `stays`, which do not move: the normal towards the body, what
// it makes of its spin, and the distance. where: as of tell_link; bodies: how many there are.
void tell_contacts(World& w, int slot, const py::tuple& points, const Links& stays, const py::tuple& where,
                   int bodies) {
  Mover& m = w.movers[slot];
  const Vec3 centre = vector(item(where.ptr(), 0));
  m.forget_contacts();
  for (const py::handle& point : points) {
    const std::pair<int, int> other{static_cast<int>(number(point.ptr(), 2)),
                                    static_cast<int>(number(point.ptr(), 4))};
    if (std::find(stays.begin(), stays.end(), other) == stays.end()) continue;
    const Vec3 n = vector(item(point.ptr(), 7)), turn = cross(vector(item(point.ptr(), 5)) - centre, n);
    const double row[7] = {n.x, n.y, n.z, turn.x, turn.y, turn.z, number(point.ptr(), 8)};
    m.contacts.insert(m.contacts.end(), row, row + 7);
  }
  m.contacts_at = place_of(where);
  m.rests_on.assign(1, bodies);
  for (const auto& [body, link] : stays) m.rests_on.push_back(body), m.rests_on.push_back(link);
}

// Whether what was told of its contacts can be believed once more.
bool contacts_stand(const World& w, int slot, const py::tuple& where, const py::tuple& motion) {
  const Vec3 v = vector(item(motion.ptr(), 0)), s = vector(item(motion.ptr(), 1));
  return w.movers[slot].contacts_stand(place_of(where), {v.x, v.y, v.z, s.x, s.y, s.z});
}

// How many bodies there were when its contacts were told, and the links that it rested on.
py::tuple rests_on(const World& w, int slot) {
  const Mover& m = w.movers[slot];
  py::list links;
  for (size_t k = 1; k < m.rests_on.size(); k += 2)
    links.append(py::make_tuple(static_cast<int>(m.rests_on[k]), static_cast<int>(m.rests_on[k + 1])));
  return py::make_tuple(m.rests_on.empty() ? 0 : static_cast<int>(m.rests_on[0]), links);
}

void clear_link(World& w, int slot) {
  make_link(w, slot);
  w.links[slot] = Link{}, w.movers[slot] = Mover{};
}

}  // namespace

void bind_links(py::module_& m, GuardedWorld& world) {
  world.def("clear_link", &clear_link)
      .def("tell_link", &tell_link)
      .def("note_link", &note_link)
      .def("may_rest", &may_rest)
      .def("keep_contacts", &keep_contacts)
      .def("tell_contacts", &tell_contacts)
      .def("contacts_stand", &contacts_stand)
      .def("rests_on", &rests_on);
  m.def("link_frame", [](const py::tuple& info, const py::tuple& where) {
    Link l;
    place(l, info.ptr(), where.ptr());
    const Vec3 o = l.pose.origin;
    const Rot3& r = l.pose.rotation;
    const std::vector<double> axes{r.r0.x, r.r0.y, r.r0.z, r.r1.x, r.r1.y, r.r1.z, r.r2.x, r.r2.y, r.r2.z};
    return py::make_tuple(copy_of(std::vector<double>{o.x, o.y, o.z}), copy_of(axes).reshape({3, 3}));
  });
}

}  // namespace bt
