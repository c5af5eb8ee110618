// Reads pybullet's answers about bodies: nested tuples of numbers. This is faster than making arrays of them.
#pragma once
#include "bindings/arrays.h"

namespace bt {

// Item i of a tuple; and the number that it is.
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

// Places a link by p.getDynamicsInfo, and (its centre of mass, the orientation of its inertial frame).
void place(Link& l, PyObject* info, PyObject* where);
// Whether all numbers of a link and its body are finite.
bool is_finite(const World& w, int slot);
// Marks the link as one that tendons do not move.
void stand_still(World& w, int slot);

}  // namespace bt
