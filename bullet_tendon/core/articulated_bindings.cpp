// Articulated bodies: how they are built, and how a mass matrix answers.
#include "articulated.h"
#include "bindings.h"

namespace bt {

namespace {

// By joint: kind, parent, axis (3), pivot (3), turn (quaternion 4, of the parent's frame in the link's),
// limits (2).
Articulated articulated(const Ints& kinds, const Ints& parents, const Array& numbers, bool floating) {
  if (parents.size() != kinds.size() || numbers.size() != 12 * kinds.size()) throw py::value_error("joints");
  std::vector<Joint> joints;
  for (py::ssize_t j = 0; j < kinds.size(); ++j) {
    if (parents.data()[j] < 0 || parents.data()[j] > j) throw py::value_error("parents");
    const auto kind = static_cast<JointKind>(kinds.data()[j]);
    const double* p = numbers.data() + 12 * j;
    joints.push_back(
        {kind, parents.data()[j], vec(p), vec(p + 3), transposed(rotation_of(p + 6)), p[10], p[11]});
  }
  return {joints, floating};
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
      .def("moves", &Articulated::moves);
  m.def("answer", &answer_of);
}

}  // namespace bt
