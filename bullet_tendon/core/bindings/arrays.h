// Arrays and tuples of Python, and what they are in the core.
#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <functional>
#include <utility>
#include <vector>

#include "world/world.h"

namespace py = pybind11;
using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Ints = py::array_t<int, py::array::c_style | py::array::forcecast>;

namespace bt {

inline Vec3 vec(const Array& a) { return {a.data()[0], a.data()[1], a.data()[2]}; }
inline Vec3 vec(const double* p) { return {p[0], p[1], p[2]}; }
inline py::tuple tuple(Vec3 v) { return py::make_tuple(v.x, v.y, v.z); }

inline Array rows_of(const std::vector<Vec3>& v) {
  Array out({static_cast<py::ssize_t>(v.size()), static_cast<py::ssize_t>(3)});
  double* p = out.mutable_data();
  for (const Vec3& x : v) {
    *p++ = x.x;
    *p++ = x.y;
    *p++ = x.z;
  }
  return out;
}

inline Array rows_of(const Field& f) {
  std::vector<Vec3> v(f.size());
  for (int i = 0; i < f.size(); ++i) v[i] = f.at(i);
  return rows_of(v);
}

inline Array copy_of(const std::vector<double>& v) {
  return Array(static_cast<py::ssize_t>(v.size()), v.data());
}

inline void fill(Field& f, const Array& a) {
  for (int i = 0; i < f.size(); ++i) f.set(i, vec(a.data() + 3 * i));
}

inline std::vector<double> list_of(const Array& a) { return {a.data(), a.data() + a.size()}; }

inline Rot3 rotation(const double* p) { return {vec(p), vec(p + 3), vec(p + 6)}; }

inline std::vector<Vec3> points_of(const Array& a) {
  std::vector<Vec3> points(a.size() / 3);
  for (size_t i = 0; i < points.size(); ++i) points[i] = vec(a.data() + 3 * i);
  return points;
}

inline Field field_of(const Array& a) {
  Field f(static_cast<int>(a.shape(0)));
  fill(f, a);
  return f;
}

// pybullet returns nested tuples of numbers. Reading these directly is faster than converting them to arrays.

// Item i of a tuple, and its value as a number.
inline PyObject* item(PyObject* tuple, int i) {
  if (PyTuple_CheckExact(tuple) && i < PyTuple_GET_SIZE(tuple)) return PyTuple_GET_ITEM(tuple, i);
  PyObject* found = PyTuple_GetItem(tuple, i);
  if (!found) throw py::error_already_set();
  return found;
}

inline double number(PyObject* tuple, int i) {
  PyObject* found = item(tuple, i);
  if (PyFloat_CheckExact(found)) return PyFloat_AS_DOUBLE(found);
  const double value = PyFloat_AsDouble(found);
  if (value == -1 && PyErr_Occurred()) throw py::error_already_set();
  return value;
}

inline Vec3 vector(PyObject* tuple) { return {number(tuple, 0), number(tuple, 1), number(tuple, 2)}; }

inline Rot3 turn_of(PyObject* tuple) {
  const double q[4] = {number(tuple, 0), number(tuple, 1), number(tuple, 2), number(tuple, 3)};
  return rotation_of(q);
}

// A contact as Python has it: tendon, segment, other tendon, link, kind, position (3), normal (3), distance,
// normal and friction force.
inline std::array<double, 14> row_of(const ContactRecord& c) {
  return {double(c.tendon), double(c.segment), double(c.other_tendon), double(c.link),  double(c.kind),
          c.position.x,     c.position.y,      c.position.z,           c.normal.x,      c.normal.y,
          c.normal.z,       c.distance,        c.normal_force,         c.friction_force};
}

// Articulated bodies (bindings/bodies.cpp).
void bind_articulated(py::module_& m);

// Corners (t, 3, 3).
inline std::vector<Triangle> triangles_of(const Array& corners) {
  std::vector<Triangle> out(corners.size() / 9);
  const double* p = corners.data();
  for (Triangle& t : out) {
    t = {vec(p), vec(p + 3), vec(p + 6)};
    p += 9;
  }
  return out;
}

// One call at a time in a world: a reader in another thread waits until a step is over. The interpreter is
// free while it waits.
class WorldLock {
 public:
  explicit WorldLock(const World& w) : lock_(w.mutex, std::try_to_lock) {
    if (lock_.owns_lock()) return;
    py::gil_scoped_release release;
    lock_.lock();
  }

 private:
  std::unique_lock<std::recursive_mutex> lock_;
};

// The same function, with the world locked.
template <class R, class W, class... A>
auto guarded(std::function<R(W&, A...)> f) {
  return [f = std::move(f)](W& w, A... a) -> R {
    WorldLock lock(w);
    return f(w, std::forward<A>(a)...);
  };
}
template <class R, class... A>
auto guarded(R (World::*f)(A...)) {
  return guarded(std::function<R(World&, A...)>(f));
}
template <class R, class... A>
auto guarded(R (World::*f)(A...) const) {
  return guarded(std::function<R(const World&, A...)>(f));
}
template <class F>
auto guarded(F f) {
  return guarded(std::function(f));
}

// The Python class of World: every method that is defined through it locks the world.
class GuardedWorld {
 public:
  explicit GuardedWorld(py::module_& m) : of_(m, "World") {}
  GuardedWorld& def(py::detail::initimpl::constructor<> init) {
    of_.def(init);
    return *this;
  }
  template <class F>
  GuardedWorld& def(const char* name, F f) {
    of_.def(name, guarded(f));
    return *this;
  }

 private:
  py::class_<World> of_;
};

// What elements exert on links, about their centres of mass (k, 6), and the second derivatives of their
// potentials by the twists of these links (6 k, 6 k), by further rotation vectors (bindings/element.cpp).
struct ElementTerms {
  Array wrenches, stiffness;
  // links: number of all links. slots (k).
  ElementTerms(size_t links, const std::vector<int>& slots);
  // An element that is evaluated: its wrenches, and how its arms turn.
  void add(const Element& element);
  void add(const std::vector<LinkPair>& pairs);

 private:
  std::vector<py::ssize_t> place_;  // by slot of a link, its place among the k, or -1
};

// Readers of links and of bodies with joints (bindings/bodies.cpp).
void bind_links(py::module_& m, GuardedWorld& world);
void bind_bodies(py::module_& m, GuardedWorld& world);
// Distances that have closed forms (bindings/collision.cpp).
void bind_primitives(py::module_& m);

// Module _core.testing: what only tests call.
// Single terms of a step's potential (bindings/testing.cpp).
void bind_terms(py::module_& testing);
// The search for tendons that touch (bindings/testing.cpp).
void bind_pairs(py::module_& testing);
// The sparse and the banded solver by themselves (bindings/testing.cpp).
void bind_sparse(py::module_& testing);

// A tendon that is about to be changed. Wakes it.
inline Tendon& stirred(World& w, int tendon) {
  w.wake_tendon(tendon);
  return *w.scene.tendons[tendon];
}

void bind_report(py::module_& m);
// Signed distances of meshes (bindings/element.cpp).
void bind_distance_grid(py::module_& m);

// World's methods, by room.
void bind_material(py::module_& m);
void bind_world_tendon(GuardedWorld& world);
void bind_world_bodies(GuardedWorld& world);
void bind_world_collision(GuardedWorld& world);
void bind_world_elements(GuardedWorld& world);
void bind_world_world(GuardedWorld& world);

}  // namespace bt
