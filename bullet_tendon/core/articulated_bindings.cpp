// Articulated bodies: their Jacobians, mass matrix and weight.
#include "articulated.h"
#include "bindings.h"

namespace bt {

namespace {

Articulated articulated(const Ints& kinds, const Ints& parents, const Array& axes, bool floating) {
  if (parents.size() != kinds.size() || axes.size() != 3 * kinds.size()) throw py::value_error("joints");
  std::vector<Joint> joints;
  for (py::ssize_t j = 0; j < kinds.size(); ++j) {
    if (parents.data()[j] < 0 || parents.data()[j] > j) throw py::value_error("parents");
    const auto kind = static_cast<JointKind>(kinds.data()[j]);
    joints.push_back({kind, parents.data()[j], vec(axes.data() + 3 * j)});
  }
  return {joints, floating};
}

// A flat list: an array takes longer to make than all that is computed from it.
void place(Articulated& body, const py::list& numbers) {
  std::vector<double> row(numbers.size());
  for (std::size_t i = 0; i < row.size(); ++i) row[i] = PyFloat_AsDouble(numbers[i].ptr());
  if (PyErr_Occurred()) throw py::error_already_set();
  if (row.size() != static_cast<std::size_t>(kPlacementWidth * body.links()))
    throw py::value_error("numbers");
  body.place(row.data());
}

py::tuple dynamics(Articulated& body, const py::list& numbers, const py::list& chosen) {
  place(body, numbers);
  const py::ssize_t n = body.dofs(), count = chosen.size();
  Array jacobians({count, py::ssize_t{6}, n}), mass({n, n}), weight({n, py::ssize_t{3}});
  for (py::ssize_t i = 0; i < count; ++i) {
    const int link = chosen[i].cast<int>();
    if (link < 0 || link >= body.links()) throw py::index_error("links");
    body.jacobian(link, jacobians.mutable_data() + 6 * n * i);
  }
  body.mass_matrix(mass.mutable_data());
  body.weight(weight.mutable_data());
  return py::make_tuple(jacobians, mass, weight);
}

Array answer_of(const Array& mass, const Array& forces) {
  if (mass.ndim() != 2 || forces.ndim() != 2 || forces.shape(0) != mass.shape(0))
    throw py::value_error("forces");
  Array out({forces.shape(0), forces.shape(1)});
  std::copy(forces.data(), forces.data() + forces.size(), out.mutable_data());
  answer(static_cast<int>(forces.shape(0)), static_cast<int>(forces.shape(1)), mass.data(),
         out.mutable_data());
  return out;
}

}  // namespace

void bind_articulated(py::module_& m) {
  m.attr("HINGE") = static_cast<int>(JointKind::hinge);
  m.attr("SLIDER") = static_cast<int>(JointKind::slider);
  m.attr("BALL") = static_cast<int>(JointKind::ball);
  m.attr("FIXED") = static_cast<int>(JointKind::fixed);
  py::class_<Articulated>(m, "Articulated")
      .def(py::init(&articulated))
      .def_property_readonly("links", &Articulated::links)
      .def_property_readonly("dofs", &Articulated::dofs)
      .def("dynamics", &dynamics);
  m.def("answer", &answer_of);
}

}  // namespace bt
