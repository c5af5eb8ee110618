// Python's access to ligaments.
#include <pybind11/stl.h>

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "bindings/arrays.h"

namespace bt {

namespace {

Material axial_material(double stiffness, double exponent, double toe_strain, bool tension_only,
                        double damping, double damping_exponent, bool lengthening_only) {
  Material m;
  m.law = {exponent, toe_strain, tension_only, damping_exponent, false, lengthening_only};
  m.stiffness = stiffness;
  m.damping = damping;
  return m;
}

// links (n): slots. locals (n, 3): points in the frames of the links [m].
int add_ligament(World& w, const Ints& links, const Array& locals, double rest, double stiffness,
                 double exponent, double toe_strain, bool tension_only, double damping,
                 double damping_exponent, bool lengthening_only) {
  const std::vector<Vec3> points = points_of(locals);
  std::vector<PathPoint> path;
  for (size_t i = 0; i < points.size(); ++i) path.push_back({links.data()[i], points[i]});
  const Material material = axial_material(stiffness, exponent, toe_strain, tension_only, damping,
                                           damping_exponent, lengthening_only);
  return w.add_ligament(std::make_unique<Ligament>(path, material, rest));
}

Ligament& ligament_of(const World& w, int slot) { return *w.scene.ligaments.all().at(slot); }

}  // namespace

void bind_world_elements(GuardedWorld& world) {
  world.def("has_elements", [](const World& w) { return w.scene.has_elements(); })
      .def("add_ligament", &add_ligament)
      .def("remove_ligament", &World::remove_ligament)
      .def("ligament_force", [](const World& w, int slot) { return ligament_of(w, slot).force; })
      .def("ligament_length", [](const World& w, int slot) { return ligament_of(w, slot).length; })
      .def("ligament_rest", [](const World& w, int slot) { return ligament_of(w, slot).rest; })
      .def("set_ligament_rest",
           [](World& w, int slot, double rest) {
             w.forbid_resolve();
             ligament_of(w, slot).rest = rest;
           })
      .def("ligament_tension", [](const World& w, int slot) { return ligament_of(w, slot).tension; })
      .def("set_ligament_tension", [](World& w, int slot, double tension) {
        w.forbid_resolve();
        ligament_of(w, slot).tension = tension;
      });
}

}  // namespace bt
