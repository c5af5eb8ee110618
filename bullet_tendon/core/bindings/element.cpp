// Python's access to ligaments and cartilage.
#include <pybind11/stl.h>

#include <algorithm>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bodies/finite_rotation.h"

namespace bt {

ElementTerms::ElementTerms(size_t links, const std::vector<int>& slots)
    : wrenches({static_cast<py::ssize_t>(slots.size()), py::ssize_t{6}}),
      stiffness({6 * static_cast<py::ssize_t>(slots.size()), 6 * static_cast<py::ssize_t>(slots.size())}),
      place_(links, -1) {
  for (Array* array : {&wrenches, &stiffness})
    std::fill(array->mutable_data(), array->mutable_data() + array->size(), 0.0);
  for (size_t i = 0; i < slots.size(); ++i) place_.at(slots[i]) = static_cast<py::ssize_t>(i);
}

void ElementTerms::add(const Element& element) {
  for (const TouchedLink& touched : element.touched()) {
    const py::ssize_t at = place_[touched.link];
    if (at < 0) continue;
    const double six[6] = {touched.force.x,  touched.force.y,  touched.force.z,
                           touched.torque.x, touched.torque.y, touched.torque.z};
    for (int k = 0; k < 6; ++k) wrenches.mutable_at(at, k) += six[k];
    FiniteRotation turned;
    turned.pulls = touched.pulls;
    const Mat3 arms = full(turned.stiffness());  // the gradient is minus the force
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) stiffness.mutable_at(6 * at + 3 + r, 6 * at + 3 + c) -= arms.entry(r, c);
  }
}

void ElementTerms::add(const std::vector<LinkPair>& pairs) {
  for (const LinkPair& pair : pairs) {
    const py::ssize_t one = place_[pair.one], other = place_[pair.other];
    if (one < 0 || other < 0) continue;
    for (int r = 0; r < 6; ++r)
      for (int c = 0; c < 6; ++c) {
        stiffness.mutable_at(6 * one + r, 6 * other + c) += pair.stiffness[6 * r + c];
        if (one != other) stiffness.mutable_at(6 * other + c, 6 * one + r) += pair.stiffness[6 * r + c];
      }
  }
}

namespace {

// wraps: (slot, shape, semi-axes, position, axes by rows), in the frame of its link.
std::vector<Wrap> wraps_of(const py::list& wraps) {
  std::vector<Wrap> out;
  for (const py::handle& of : wraps) {
    const auto [link, shape, radii, position, axes] = of.cast<std::tuple<int, int, Vec3, Vec3, Rot3>>();
    out.push_back({link, static_cast<WrapShape>(shape), {axes, position}, radii});
  }
  return out;
}

// links (n): slots. locals (n, 3): points in the frames of the links [m].
int add_ligament(World& w, const Ints& links, const std::vector<Vec3>& locals, double rest,
                 const Material& material, const py::list& wraps) {
  std::vector<PathPoint> path;
  for (size_t i = 0; i < locals.size(); ++i) path.push_back({links.data()[i], locals[i]});
  return w.add_element(w.scene.ligaments, std::make_unique<Ligament>(path, wraps_of(wraps), material, rest));
}

// Points of a path through these points, those along wraps included; wraps in the same axes.
std::vector<Vec3> trace_path(const std::vector<Vec3>& path, const py::list& wraps) {
  const std::vector<Wrap> around = wraps_of(wraps);
  std::vector<Vec3> out{path.front()};
  for (size_t i = 0; i + 1 < path.size(); ++i) trace(around, path[i], path[i + 1], out);
  return out;
}

Ligament& ligament_of(const World& w, int slot) { return *w.scene.ligaments.at(slot); }

using Grid = std::shared_ptr<DistanceGrid>;

// centres (t, 3), areas (t), regions (t) and unit normals (t, 3) of the triangles of B, in the frame of its
// link. resolution [m]: within which they are merged. law: its numbers, and whether it is logarithmic.
int add_cartilage(World& w, int link_a, const Grid& grid, int link_b, const std::vector<Vec3>& centres,
                  const std::vector<double>& areas, const Ints& regions, const std::vector<Vec3>& normals,
                  double resolution, double foundation, double thickness, bool logarithmic, double damping) {
  FoundationSurface triangles{centres, areas, {regions.data(), regions.data() + regions.size()}};
  const FoundationSurface points = merged(triangles, normals, resolution);
  return w.add_element(
      w.scene.cartilages,
      std::make_unique<Cartilage>(link_a, grid, link_b, std::move(triangles), points,
                                  CartilageModel{{foundation, thickness, logarithmic}, damping}));
}

Cartilage& cartilage_of(const World& w, int slot) { return *w.scene.cartilages.at(slot); }

// Of each connected patch: force, torque, area, centre of pressure, largest pressure, greatest depth.
py::list pressed_regions(const World& w, int slot) {
  py::list out;
  for (const PressedRegion& r : cartilage_of(w, slot).regions)
    out.append(py::make_tuple(r.force, r.torque, r.area, r.centre, r.max_pressure, r.max_depth));
  return out;
}

// All elements where the links are now, at rest: potential [J], largest force [N], and ElementTerms of the
// links of these slots. accept: this becomes the elements' state.
py::tuple element_terms(World& w, const std::vector<int>& slots, bool accept) {
  std::vector<LinkEnd> ends;
  for (const Link& link : w.scene.links) ends.push_back({link.centre, {}});
  ElementTerms terms(w.scene.links.size(), slots);
  std::vector<LinkPair>& pairs = w.scene.element_pairs.all;
  for (LinkPair& pair : pairs) pair.stiffness.fill(0);
  double potential = 0, largest = 0;
  w.scene.each_element([&](Element& element) {
    element.begin(w.scene.links, 0);
    element.evaluate(ends);
    element.add_stiffness(pairs, false);
    element.add_curvature(pairs);
    if (accept) element.accept();
    potential += element.potential();
    largest = std::max(largest, element.largest_force());
    terms.add(element);
  });
  terms.add(pairs);
  return py::make_tuple(potential, largest, terms.wrenches, terms.stiffness);
}

// (n, n) by how much less generalized force there is by further coordinates, because Jacobians and forces
// turn. jacobians (k, 6, n) of links; wrenches (2, k, 6) on them about their centres of mass: those that have
// a potential, and those that follow their link. columns (n): numbers of the coordinates, from the root on;
// floats: 0 to 5 are the twist of a base.
//
// The coordinate i turns the columns of all j beyond it, by a_i x lin_j and a_i x a_j. Those of the rotation
// of a base are components of one rotation vector, so that their order does not count.
Array jacobian_curvature(const Array& jacobians, const Array& wrenches, const std::vector<int>& columns,
                         bool floats) {
  const py::ssize_t n = static_cast<py::ssize_t>(columns.size()), links = jacobians.size() / (6 * n);
  Array out({n, n});
  std::fill(out.mutable_data(), out.mutable_data() + n * n, 0.0);
  std::vector<Vec3> linear(n), angular(n);
  for (py::ssize_t of = 0; of < 2 * links; ++of) {
    const double *w = wrenches.data() + 6 * of, *jacobian = jacobians.data() + 6 * n * (of % links);
    const Vec3 force = vec(w), torque = vec(w + 3);
    if (max_abs(force) == 0 && max_abs(torque) == 0) continue;
    for (py::ssize_t i = 0; i < n; ++i) {
      linear[i] = {jacobian[i], jacobian[n + i], jacobian[2 * n + i]};
      angular[i] = {jacobian[3 * n + i], jacobian[4 * n + i], jacobian[5 * n + i]};
    }
    auto push = [&](py::ssize_t i, py::ssize_t j) { return dot(force, cross(angular[i], linear[j])); };
    auto twist = [&](py::ssize_t i, py::ssize_t j) { return dot(torque, cross(angular[i], angular[j])); };
    const bool follows = of >= links;
    for (py::ssize_t i = 0; i < n; ++i)
      for (py::ssize_t j = 0; j < n; ++j) {
        const bool before = columns[i] < columns[j];
        const bool of_base =
            floats && std::min(columns[i], columns[j]) >= 3 && std::max(columns[i], columns[j]) < 6;
        double change = of_base ? 0.5 * (push(i, j) + push(j, i)) : before ? push(i, j) : push(j, i);
        if (follows)
          change += twist(i, j) + dot(linear[i], cross(angular[j], force)) +
                    (of_base  ? 0.5 * twist(j, i)
                     : before ? 0
                              : twist(j, i));
        else if (!of_base)
          change += 0.5 * (before ? twist(i, j) : twist(j, i));
        out.mutable_at(i, j) -= change;
      }
  }
  return out;
}

}  // namespace

void bind_elements(py::module_& m, GuardedWorld& world) {
  m.def("trace_path", &trace_path);
  m.def("jacobian_curvature", &jacobian_curvature);
  py::class_<SignedDistance, std::shared_ptr<SignedDistance>>(m, "SignedDistance")
      .def(py::init<std::vector<Vec3>, std::vector<SignedDistance::Indices>>())
      .def_property_readonly("open", &SignedDistance::open)
      .def("volume", &SignedDistance::volume)
      .def("nodes", [](const SignedDistance& d, double spacing,
                       double depth) { return DistanceGrid::nodes_of(d.box(depth), spacing); })
      .def("__call__", [](const SignedDistance& d, const std::vector<Vec3>& points) {
        std::vector<double> out;
        for (const Vec3& x : points) out.push_back(d(x));
        return out;
      });
  py::class_<DistanceGrid, Grid>(m, "DistanceGrid")
      // A call guard would hold while pybind11 enters the object in its table of instances, too.
      .def(py::init([](const SignedDistance& distance, double spacing, double depth) {
        py::gil_scoped_release release;
        return std::make_shared<DistanceGrid>(distance, spacing, depth);
      }))
      .def_static("of_numbers",
                  [](const std::vector<double>& numbers) { return std::make_shared<DistanceGrid>(numbers); })
      .def("numbers", &DistanceGrid::numbers);
  world.def("has_elements", [](const World& w) { return w.scene.has_elements(); })
      .def("add_ligament", &add_ligament)
      .def("remove_ligament", [](World& w, int slot) { w.remove_element(w.scene.ligaments, slot); })
      .def("element_terms", &element_terms)
      .def("forbid_resolve", &World::forbid_resolve)
      .def("add_cartilage", &add_cartilage)
      .def("remove_cartilage", [](World& w, int slot) { w.remove_element(w.scene.cartilages, slot); })
      .def("flat_depth",
           [](World& w, int cartilage) {
             Cartilage::Flattening& of = cartilage_of(w, cartilage).flattening;
             const double depth = of.reported ? 0 : of.depth;
             of.reported |= depth > 0;
             return depth;
           })
      .def("pressed_regions", &pressed_regions)
      .def("cartilage_depths",
           [](const World& w, int slot) { return cartilage_of(w, slot).depths(w.scene.links); })
      .def("cartilage_points",
           [](const World& w, int slot) {
             const FoundationSurface& points = cartilage_of(w, slot).points();
             return py::make_tuple(points.centres, points.areas);
           })
      .def("cartilage_facing",
           [](const World& w, int slot, const std::vector<Vec3>& normals) {
             return cartilage_of(w, slot).facing(w.scene.links, normals);
           })
      .def("ligament_force", [](const World& w, int slot) { return ligament_of(w, slot).force; })
      .def("ligament_is_ruptured", [](const World& w, int slot) { return ligament_of(w, slot).ruptured; })
      .def("ligament_points",
           [](const World& w, int slot) {
             std::vector<Vec3> points;
             const double length = ligament_of(w, slot).length_at(w.scene.links, points);
             return py::make_tuple(length, points);
           })
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
