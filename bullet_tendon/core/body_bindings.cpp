// Bodies with joints, as pybullet tells of them.
#include <pybind11/stl.h>

#include <algorithm>

#include "articulated.h"
#include "told.h"

namespace bt {

namespace {

// What pybullet tells of a body: p.getDynamicsInfo of all links, p.getBasePositionAndOrientation,
// p.getBaseVelocity, p.getJointStatesMultiDof of the joints that move.
struct Told {
  py::list infos;
  py::tuple base, motion, joints;
};

void take(PyObject* from, int count, std::vector<double>& numbers) {
  for (int i = 0; i < count; ++i) numbers.push_back(number(from, i));
}

// The rates of the degrees of freedom, and where the joints are.
void read_joints(const Articulated& body, const py::tuple& motion, const py::tuple& joints,
                 std::vector<double>& rates, std::vector<double>& places) {
  rates.clear(), places.clear();
  for (int part = 0; part < 2 && body.floats(); ++part) take(item(motion.ptr(), part), 3, rates);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    PyObject* state = item(joints.ptr(), static_cast<int>(j));
    PyObject *place = item(state, 0), *rate = item(state, 1);
    take(place, static_cast<int>(PyTuple_Size(place)), places);
    take(rate, static_cast<int>(PyTuple_Size(rate)), rates);
  }
  if (static_cast<int>(rates.size()) != body.dofs() || static_cast<int>(places.size()) != body.places())
    throw py::value_error("joints");
}

void place(Articulated& body, const Told& told, const std::vector<double>& places) {
  if (static_cast<int>(told.infos.size()) != body.links()) throw py::value_error("infos");
  std::vector<double> inertias, base;
  inertias.reserve(kInertiaWidth * body.links());
  for (const py::handle& info : told.infos) {
    take(info.ptr(), 1, inertias);
    for (int part = 2; part < 5; ++part) take(item(info.ptr(), part), part == 4 ? 4 : 3, inertias);
  }
  for (int part = 0; part < 2; ++part) take(item(told.base.ptr(), part), 3 + part, base);
  body.place(inertias.data(), base.data(), places.data());
}

void set_mover(Mover& m, Articulated& body, const Told& told) {
  const std::size_t n = body.dofs();
  std::vector<double> places, mass(n * n), weight(3 * n);
  read_joints(body, told.motion, told.joints, m.rates, places);
  place(body, told, places);
  body.mass_matrix(mass.data()), body.weight(weight.data());
  dense::set_identity(static_cast<int>(n), m.free);
  answer(static_cast<int>(n), static_cast<int>(n), mass.data(), m.free.data());
  m.falls.assign(3 * n, 0.0);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t e = 0; e < 3; ++e) m.falls[3 * i + e] += m.free[i * n + k] * weight[3 * k + e];
  body.stops(places.data(), m.limits);
}

// Velocity and spin of a link by the rates, and by the base's motion where that is moved by hand.
void set_motion(Link& l, const Articulated& body, const Told& told, const std::vector<double>& rates) {
  l.now_velocity = l.now_spin = {};
  if (!body.floats()) {
    const Vec3 spin = vector(item(told.motion.ptr(), 1));
    l.now_velocity =
        vector(item(told.motion.ptr(), 0)) + cross(spin, l.centre - vector(item(told.base.ptr(), 0)));
    l.now_spin = spin;
  }
  if (l.jacobian.empty()) return;
  std::vector<double> twist;
  dense::multiply(l.jacobian, rates, twist);
  l.now_velocity += Vec3{twist[0], twist[1], twist[2]}, l.now_spin += Vec3{twist[3], twist[4], twist[5]};
}

// Links of one body, by their slots, in the first of which is the body's mover. false: some number is not
// finite.
bool tell_body(World& w, Articulated& body, const std::vector<int>& slots, const std::vector<int>& links,
               const py::list& infos, const py::tuple& base, const py::tuple& motion,
               const py::tuple& joints) {
  const Told told{infos, base, motion, joints};
  for (int slot : slots) make_link(w, slot);
  Mover& m = w.movers[slots[0]];
  set_mover(m, body, told);
  for (std::size_t i = 0; i < slots.size(); ++i) {
    const int link = links[i];
    Link& l = w.links[slots[i]];
    l.centre = body.centre(link), l.pose = body.frame(link);
    if (i > 0) stand_still(w, slots[i]);
    l.mover = body.moves(link) ? slots[0] : -1;
    l.jacobian.assign(body.moves(link) ? 6 * m.n() : 0, 0.0);
    if (body.moves(link)) body.jacobian(link, l.jacobian.data());
    set_motion(l, body, told, m.rates);
  }
  return std::all_of(slots.begin(), slots.end(), [&](int slot) { return told_well(w, slot); });
}

// Its rates right after a step; whether it seems to have been let go.
bool note_body(World& w, int slot, const Articulated& body, const py::tuple& motion,
               const py::tuple& joints) {
  std::vector<double> rates, places;
  read_joints(body, motion, joints, rates, places);
  return w.note(slot, rates);
}

// J (links, 6, dofs) and the mass matrix.
py::tuple dynamics(Articulated& body, const py::list& infos, const py::tuple& base, const py::tuple& motion,
                   const py::tuple& joints, const py::list& chosen) {
  std::vector<double> rates, places;
  read_joints(body, motion, joints, rates, places);
  place(body, Told{infos, base, motion, joints}, places);
  const py::ssize_t n = body.dofs(), count = chosen.size();
  Array jacobians({count, py::ssize_t{6}, n}), mass({n, n});
  for (py::ssize_t i = 0; i < count; ++i) {
    const int link = chosen[i].cast<int>();
    if (link < 0 || link >= body.links()) throw py::index_error("links");
    body.jacobian(link, jacobians.mutable_data() + 6 * n * i);
  }
  body.mass_matrix(mass.mutable_data());
  return py::make_tuple(jacobians, mass);
}

}  // namespace

void bind_bodies(py::module_& m, GuardedWorld& world) {
  world.def("tell_body", &tell_body).def("note_body", &note_body);
  m.def("dynamics", &dynamics);
}

}  // namespace bt
