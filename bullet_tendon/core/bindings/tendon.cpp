// Python's access to tendons and their anchors.
#include <pybind11/stl.h>

#include <memory>
#include <type_traits>
#include <vector>

#include "bindings/arrays.h"

namespace bt {

namespace {

Material material_of(double stiffness, double exponent, double toe_strain, bool tension_only, double damping,
                     double damping_exponent, bool whole_velocity, bool lengthening_only,
                     double shear_stiffness, double bending_stiffness, double linear_density,
                     const std::vector<double>& weights, const std::vector<double>& times, double most_force,
                     double most_strain) {
  const Law law{exponent, toe_strain, tension_only, damping_exponent, whole_velocity, lengthening_only};
  return {law,
          stiffness,
          damping,
          shear_stiffness,
          bending_stiffness,
          linear_density,
          {weights, times, most_force, most_strain}};
}

int add_tendon(World& w, const std::vector<Vec3>& points, double radius, double friction,
               const Material& material) {
  return w.add_tendon(std::make_unique<Tendon>(points, radius, friction, material));
}

Anchor& anchor_of(World& w, int tendon, int id) {
  for (Anchor& h : w.scene.tendons[tendon]->anchors)
    if (h.id == id) return h;
  throw py::key_error("no such anchor");
}

void remove_anchor(World& w, int tendon, int id) {
  remove_where(stirred(w, tendon).anchors, [&](const Anchor& h) { return h.id == id; });
  w.scene.tendons[tendon]->smooth = false;
}

void add_anchor(World& w, int tendon, const Anchor& anchor) {
  if (anchor.link >= 0) w.ensure_link(anchor.link);
  stirred(w, tendon).anchors.push_back(anchor);
  w.scene.tendons[tendon]->smooth = false;
}

// The stiffness of what holds a particle at a point by no more than a force [N/m].
double holding_stiffness(const World& w, int tendon, double most_force) {
  return most_force / (kGive * w.scene.tendons[tendon]->radius);
}

// A line from a particle to a point of a link: its length now, its stiffness, and the force beyond which it
// slips. Length and stiffness 0: a device that pulls by that force.
void add_line(World& w, int tendon, int id, int particle, int link, Vec3 local, double length,
              double stiffness, double most_force) {
  Anchor h;
  h.id = id;
  h.particle = particle;
  h.link = link;
  h.local = local;
  h.is_line = true;
  h.rigid = false;
  h.line.rest = length;
  h.line.spring = length > 0 ? stiffness : holding_stiffness(w, tendon, most_force);
  h.line.most_force = most_force;
  add_anchor(w, tendon, h);
}

void set_line_load(World& w, int tendon, int id, double most_force) {
  w.wake_tendon(tendon);
  Line& line = anchor_of(w, tendon, id).line;
  line.most_force = most_force;
  if (line.rest == 0) line.spring = holding_stiffness(w, tendon, most_force);
}

// stiffness: 0 for a rigid grip. most_force: 0 without a limit.
void set_grip(World& w, int tendon, int id, Vec3 goal, double stiffness, double viscosity,
              double most_force) {
  Anchor& h = anchor_of(w, tendon, id);
  const bool exact = stiffness == 0 && most_force > 0;
  if (exact) stiffness = holding_stiffness(w, tendon, most_force);
  if (norm(goal - h.target.goal) > 0 || h.stiffness.xx != stiffness || h.viscosity != viscosity ||
      h.most_force != most_force)
    w.wake_tendon(tendon);
  h.target.goal = goal;
  h.rigid = stiffness == 0;
  h.exact = exact;
  h.stiffness = identity(stiffness);
  h.viscosity = viscosity;
  h.most_force = most_force;
}

}  // namespace

void bind_tendons(py::module_& m, GuardedWorld& world) {
  py::class_<Material>(m, "Material").def(py::init(&material_of));
  world.def("add_tendon", &add_tendon)
      .def("remove_tendon", &World::remove_tendon)
      .def("positions", [](World& w, int c) { return w.scene.tendons[c]->x; })
      .def("velocities", [](World& w, int c) { return w.scene.tendons[c]->user_velocities(); })
      .def("set_state",
           [](World& w, int c, const Field& x, const Field& v) {
             Tendon& tendon = stirred(w, c);
             w.forbid_resolve();
             // The hands that hold it are moved with it.
             for (Anchor& h : tendon.anchors) h.target.last_aim -= tendon.x.at(h.particle);
             tendon.x = x;
             tendon.v = v;
             tendon.spread_coincident();
             tendon.find_overlaid();
             tendon.reset_history();
             for (Anchor& h : tendon.anchors) h.target.last_aim += tendon.x.at(h.particle);
           })
      .def("stop", [](World& w, int c) { stirred(w, c).stop(); })
      .def("guess_multipliers", [](World& w, int c, Vec3 g) { stirred(w, c).guess_multipliers(g); })
      .def("masses", [](World& w, int c) { return w.scene.tendons[c]->mass; })
      .def("rest", [](World& w, int c) { return w.scene.tendons[c]->rest; })
      .def("set_rest",
           [](World& w, int c, const std::vector<double>& rest) {
             w.forbid_resolve();
             stirred(w, c).set_rest(rest);
           })
      .def("set_point_mass",
           [](World& w, int c, int i, double m) {
             stirred(w, c).set_point_mass(i, m);
             w.scene.tendons[c]->smooth = false;
           })
      .def("tension",
           [](World& w, int c) {
             std::vector<double> t;
             w.scene.tendons[c]->tension(t);
             return t;
           })
      .def("torn", [](World& w, int c) { return w.scene.tendons[c]->torn; })
      .def("is_asleep", [](World& w, int c) { return w.scene.tendons[c]->sleeping_island >= 0; })
      .def("energy", [](World& w, int c) { return w.scene.tendons[c]->energy(); })
      .def("set_force", [](World& w, int c, int i, Vec3 f) { stirred(w, c).force.set(i, f); })
      .def("force", [](World& w, int c, int i) { return w.scene.tendons[c]->force.at(i); })
      .def("add_grip",
           [](World& w, int c, int id, int particle, Vec3 target) {
             Anchor h;
             h.id = id;
             h.particle = particle;
             h.target.goal = h.target.last_aim = target;
             add_anchor(w, c, h);
           })
      .def("set_grip", &set_grip)
      .def("add_attachment",
           [](World& w, int c, int id, int particle, int link, Vec3 local) {
             Anchor h;
             h.id = id;
             h.particle = particle;
             h.link = link;
             h.local = local;
             add_anchor(w, c, h);
           })
      .def("add_line", &add_line)
      .def("set_line_load", &set_line_load)
      .def("line_load", [](World& w, int c, int id) { return anchor_of(w, c, id).line.most_force; })
      .def("line_tension", [](World& w, int c, int id) { return anchor_of(w, c, id).line.tension; })
      .def("line_slip", [](World& w, int c, int id) { return anchor_of(w, c, id).line.slip; })
      .def("set_clamp",
           [](World& w, int c, int id, Vec3 direction) {
             Anchor& h = anchor_of(w, c, id);
             w.wake_tendon(c);
             h.clamped = true;
             h.direction = direction;
           })
      .def("remove_anchor", &remove_anchor)
      .def("anchor_force", [](World& w, int c, int id) { return anchor_of(w, c, id).force.read; })
      .def("anchor_slips", [](World& w, int c, int id) { return anchor_of(w, c, id).slips; });
}

}  // namespace bt
