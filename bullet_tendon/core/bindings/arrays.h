// Arrays and tuples of Python, and what they are in the core.
#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cstring>
#include <functional>
#include <utility>
#include <vector>

#include "world/world.h"

namespace py = pybind11;
using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Ints = py::array_t<int, py::array::c_style | py::array::forcecast>;

namespace bt {

inline Vec3 vec(const double* p) { return {p[0], p[1], p[2]}; }

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
inline std::array<double, 14> row_of(const World& w, const Contact& c) {
  const Vec3 x = c.a.of(w.scene.tendons[c.a.tendon]->x), n = c.geometry.normal;
  return {double(c.a.tendon),
          double(c.a.first),
          double(c.b.tendon),
          double(c.link),
          double(c.key.kind),
          x.x,
          x.y,
          x.z,
          n.x,
          n.y,
          n.z,
          c.distance(),
          c.normal_force.value,
          norm(c.friction.force)};
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

// A tendon that is about to be changed. Wakes it.
inline Tendon& stirred(World& w, int tendon) {
  w.wake_tendon(tendon);
  return *w.scene.tendons[tendon];
}

// The classes, functions and methods of World of each room.
void bind_tendons(py::module_& m, GuardedWorld& world);
void bind_bodies(py::module_& m, GuardedWorld& world);
void bind_collision(py::module_& m, GuardedWorld& world);
void bind_elements(py::module_& m, GuardedWorld& world);
void bind_steps(py::module_& m, GuardedWorld& world);
// Module _core.testing: what only tests call.
void bind_testing(py::module_& testing);

}  // namespace bt

// Arrays and tuples where a function of the core has vectors: a vector is a tuple, but any three numbers on
// the way in; a matrix is (3, 3), a list of numbers (n), and a list of what consists of k numbers (n, k). The
// shape is not checked.
namespace pybind11::detail {

template <class Value, class Number = double>
struct ListOfRows {
  PYBIND11_TYPE_CASTER(std::vector<Value>, const_name("numpy.ndarray"));
  using Rows = array_t<Number, array::c_style | array::forcecast>;
  static constexpr ssize_t kWidth = sizeof(Value) / sizeof(Number);
  bool load(handle from, bool) {
    const Rows rows = Rows::ensure(from);
    if (!rows) return false;
    value.resize(rows.size() / kWidth);
    if (!value.empty())
      std::memcpy(static_cast<void*>(value.data()), rows.data(), value.size() * sizeof(Value));
    return true;
  }
  static handle cast(const std::vector<Value>& list, return_value_policy, handle) {
    std::vector<ssize_t> shape{static_cast<ssize_t>(list.size())};
    if (kWidth > 1) shape.push_back(kWidth);
    return Rows(shape, reinterpret_cast<const Number*>(list.data())).release();
  }
};

template <>
struct type_caster<std::vector<double>> : ListOfRows<double> {};
template <>
struct type_caster<std::vector<bt::Vec3>> : ListOfRows<bt::Vec3> {};
template <>
struct type_caster<std::vector<bt::Triangle>> : ListOfRows<bt::Triangle> {};
template <>
struct type_caster<std::vector<bt::Mat3>> : ListOfRows<bt::Mat3> {};
template <size_t N>
struct type_caster<std::vector<std::array<double, N>>> : ListOfRows<std::array<double, N>> {};
template <size_t N>
struct type_caster<std::vector<std::array<int, N>>> : ListOfRows<std::array<int, N>, int> {};

template <>
struct type_caster<bt::Field> {
  PYBIND11_TYPE_CASTER(bt::Field, const_name("numpy.ndarray"));
  bool load(handle from, bool) {
    const auto rows = from.cast<std::vector<bt::Vec3>>();
    value.resize(static_cast<int>(rows.size()));
    for (int i = 0; i < value.size(); ++i) value.set(i, rows[i]);
    return true;
  }
  static handle cast(const bt::Field& field, return_value_policy policy, handle parent) {
    std::vector<bt::Vec3> rows;
    for (int i = 0; i < field.size(); ++i) rows.push_back(field.at(i));
    return make_caster<std::vector<bt::Vec3>>::cast(rows, policy, parent);
  }
};

template <>
struct type_caster<bt::Vec3> {
  PYBIND11_TYPE_CASTER(bt::Vec3, const_name("tuple"));
  bool load(handle from, bool) {
    if (PyTuple_CheckExact(from.ptr())) return value = bt::vector(from.ptr()), true;
    const Array array = Array::ensure(from);
    if (!array || array.size() != 3) return false;
    value = bt::vec(array.data());
    return true;
  }
  static handle cast(bt::Vec3 v, return_value_policy, handle) { return make_tuple(v.x, v.y, v.z).release(); }
};

template <>
struct type_caster<bt::Rot3> {
  PYBIND11_TYPE_CASTER(bt::Rot3, const_name("numpy.ndarray"));
  bool load(handle from, bool) {
    const Array array = Array::ensure(from);
    if (!array || array.size() != 9) return false;
    value = {bt::vec(array.data()), bt::vec(array.data() + 3), bt::vec(array.data() + 6)};
    return true;
  }
  static handle cast(const bt::Rot3& r, return_value_policy policy, handle parent) {
    return make_caster<std::vector<bt::Vec3>>::cast({r.r0, r.r1, r.r2}, policy, parent);
  }
};

}  // namespace pybind11::detail
