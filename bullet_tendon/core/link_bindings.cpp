// Links and bodies as pybullet tells them: nested tuples of numbers, read here because it takes less than
// making arrays of them.
#include <pybind11/stl.h>

#include <limits>

#include "bindings.h"

namespace bt {

namespace {

double number(PyObject* tuple, int i) {
  const double value = PyFloat_AsDouble(PyTuple_GetItem(tuple, i));
  if (PyErr_Occurred()) throw py::error_already_set();
  return value;
}

Vec3 vector(PyObject* tuple) { return {number(tuple, 0), number(tuple, 1), number(tuple, 2)}; }

Rot3 turn_of(PyObject* tuple) {
  const double q[4] = {number(tuple, 0), number(tuple, 1), number(tuple, 2), number(tuple, 3)};
  return rotation_of(q);
}

Rot3 transposed(const Rot3& r) {
  return {{r.r0.x, r.r1.x, r.r2.x}, {r.r0.y, r.r1.y, r.r2.y}, {r.r0.z, r.r1.z, r.r2.z}};
}

void set_list(std::vector<double>& list, const py::handle& from) {
  if (from.is_none()) return list.clear();
  const Array numbers = py::cast<Array>(from);
  list.assign(numbers.data(), numbers.data() + numbers.size());
}

// Dynamics as p.getDynamicsInfo gives them, centre of mass, orientation of the inertial frame, velocity,
// spin. The frame of the URDF is the inertial one by the inverse of its local pose. Of bodies with maximal
// coordinates (body type 1) pybullet does not know that, and gives what was in memory: there both are one.
void place(Link& l, const py::tuple& row) {
  PyObject* info = PyTuple_GetItem(row.ptr(), 0);
  const bool maximal = number(info, 10) == 1;
  const Rot3 local = maximal ? Rot3{} : turn_of(PyTuple_GetItem(info, 4));
  l.pose.rotation = turn_of(PyTuple_GetItem(row.ptr(), 2)) * transposed(local);
  l.centre = vector(PyTuple_GetItem(row.ptr(), 1));
  l.pose.origin = l.centre - (maximal ? Vec3{} : l.pose.rotation * vector(PyTuple_GetItem(info, 3)));
  l.now_velocity = vector(PyTuple_GetItem(row.ptr(), 3));
  l.now_spin = vector(PyTuple_GetItem(row.ptr(), 4));
}

// A rigid body by itself: inverse mass, and inverse inertia in world axes, zero where it has none.
void stand_alone(Mover& m, const Link& l, const py::tuple& row, bool falls) {
  PyObject* info = PyTuple_GetItem(row.ptr(), 0);
  const Vec3 v = l.now_velocity, w = l.now_spin, inertia = vector(PyTuple_GetItem(info, 2));
  m.rates.assign({v.x, v.y, v.z, w.x, w.y, w.z});
  m.stops.clear();
  m.falls.clear();
  if (falls) m.falls.assign({1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  auto inverse = [](double moment) { return moment > 0 ? 1 / moment : 0; };
  const Rot3 axes = transposed(turn_of(PyTuple_GetItem(row.ptr(), 2)));
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

bool finite(const std::vector<double>& numbers) {
  double sum = 0;
  for (double v : numbers) sum += 0 * v;
  return sum == 0;
}

bool finite(const Link& l) {
  const Vec3 sum = l.pose.origin + l.centre + l.now_velocity + l.now_spin + l.pose.rotation.r0 +
                   l.pose.rotation.r1 + l.pose.rotation.r2;
  return max_abs(sum) < std::numeric_limits<double>::infinity();
}

// Which of the links or of their movers has a number that is not finite; -1: none.
int first_wild(const World& w) {
  for (size_t i = 0; i < w.links.size(); ++i) {
    const Mover& m = w.movers[i];
    if (!finite(w.links[i]) || !finite(m.rates) || !finite(m.free)) return static_cast<int>(i);
  }
  return -1;
}

// Links by slot: a row as of `place`, and the slot of its mover (-1: none); or none, where nothing is in use.
// Jacobians by link: (6, n), or none for the identity. Movers by slot: none; whether it falls, where it
// stands alone; or acceleration by gravity (n, 3), rates (n), response (n, n), stops (3 each).
int set_links(World& w, const py::list& rows, const std::vector<int>& leaders, const py::list& jacobians,
              const py::list& movers) {
  w.links.resize(rows.size()), w.movers.resize(rows.size());
  for (size_t i = 0; i < w.links.size(); ++i) {
    Link& l = w.links[i];
    Mover& m = w.movers[i];
    l.mover = leaders[i];
    set_list(l.jacobian, jacobians[i]);
    if (rows[i].is_none()) l = Link{};
    if (!rows[i].is_none()) place(l, rows[i]);
    if (movers[i].is_none()) {
      if (m.n() > 0) m = Mover{};
    } else if (py::isinstance<py::bool_>(movers[i])) {
      stand_alone(m, l, rows[i], movers[i].cast<bool>());
    } else {
      const py::tuple parts = movers[i];
      set_list(m.falls, parts[0]), set_list(m.rates, parts[1]);
      set_list(m.free, parts[2]), set_list(m.stops, parts[3]);
    }
  }
  return first_wild(w);
}

}  // namespace

void bind_links(py::module_& m, py::class_<World>& world) {
  world.def("set_links", &set_links);
  m.def("link_frame", [](const py::tuple& row) {
    Link l;
    place(l, row);
    const Vec3 o = l.pose.origin;
    const Rot3& r = l.pose.rotation;
    const std::vector<double> axes{r.r0.x, r.r0.y, r.r0.z, r.r1.x, r.r1.y, r.r1.z, r.r2.x, r.r2.y, r.r2.z};
    return py::make_tuple(copy_of(std::vector<double>{o.x, o.y, o.z}), copy_of(axes).reshape({3, 3}));
  });
}

}  // namespace bt
