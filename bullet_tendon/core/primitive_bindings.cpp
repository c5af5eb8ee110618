// Closed forms of distances, for what asks for them besides steps.
#include <pybind11/stl.h>

#include <array>
#include <string>

#include "bindings.h"

namespace bt {

namespace {

using Triple = std::array<double, 3>;

Vec3 vec_of(const Triple& v) { return {v[0], v[1], v[2]}; }

// kind and sizes as in shapes.primitive.
Primitive primitive_of(const std::string& kind, const std::vector<double>& sizes) {
  const double radius = sizes.at(0), half = 0.5 * sizes.back();
  Primitive s;
  s.kind = Primitive::Kind::box;
  if (kind == "box")
    s.half = {0.5 * sizes.at(0), 0.5 * sizes.at(1), 0.5 * sizes.at(2)};
  else if (kind == "sphere")
    s.growth = radius;
  else if (kind == "capsule")
    s.half = {0, 0, half}, s.growth = radius;
  else
    s.kind = Primitive::Kind::cylinder, s.radius = radius, s.half_length = half;
  return s;
}

// Of the box around it.
Triple corner_of(const Primitive& s) {
  if (s.kind == Primitive::Kind::cylinder) return {s.radius, s.radius, s.half_length};
  return {s.half.x + s.growth, s.half.y + s.growth, s.half.z + s.growth};
}

// Of the segment a + u d: signed distance, surface point and u.
py::tuple measured_along(const Primitive& s, const Triple& a, const Triple& d) {
  const PrimitiveNearest found = s.nearest(vec_of(a), vec_of(a) + vec_of(d));
  return py::make_tuple(found.distance, tuple(found.point), found.u);
}

}  // namespace

void bind_primitives(py::module_& m) {
  py::class_<Primitive>(m, "Primitive")
      .def(py::init(&primitive_of))
      .def_property_readonly("corner", &corner_of)
      .def("__call__", &measured_along);
}

}  // namespace bt
