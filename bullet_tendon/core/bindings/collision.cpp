// Python's access to shapes, tunnels and distance queries.
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bindings/arrays.h"

namespace bt {

namespace {

// kind and sizes as in shapes.primitive.
Primitive primitive_of(const std::string& kind, const std::vector<double>& sizes) {
  const double radius = sizes.at(0), half = 0.5 * sizes.back();
  Primitive s;
  s.kind = Primitive::Kind::box;
  if (kind == "box")
    s.half = {0.5 * sizes.at(0), 0.5 * sizes.at(1), 0.5 * sizes.at(2)};
  else if (kind == "sphere")
    s.growth = radius;
  else if (kind == "capsule") {
    s.half = {0, 0, half};
    s.growth = radius;
  } else {
    s.kind = Primitive::Kind::cylinder;
    s.radius = radius;
    s.half_length = half;
  }
  return s;
}

// Of the box around it.
Vec3 corner_of(const Primitive& s) {
  if (s.kind == Primitive::Kind::cylinder) return {s.radius, s.radius, s.half_length};
  return {s.half.x + s.growth, s.half.y + s.growth, s.half.z + s.growth};
}

// Of the segment a + u d: signed distance, surface point and u.
py::tuple measured_along(const Primitive& s, Vec3 a, Vec3 d) {
  const Primitive::Nearest found = s.nearest(a, a + d);
  return py::make_tuple(found.distance, found.point, found.u);
}

// Of segments a -> b (k, 3): whether each crosses the surface.
py::array_t<bool> crossed(const Surface& s, const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  py::array_t<bool> found(a.size());
  for (size_t k = 0; k < a.size(); ++k) found.mutable_at(k) = s.is_between(a[k], b.at(k));
  return found;
}

// Of segments a -> b (k, 3): rows of distance, 0 where it crosses the surface, u and surface point.
py::array_t<double> nearest_to(const Surface& s, const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  py::array_t<double> found({a.size(), size_t{5}});
  for (size_t k = 0; k < a.size(); ++k) {
    const Nearest at = s.search(a[k], b.at(k), HUGE_VAL);
    const double row[] = {at.distance, at.u, at.point.x, at.point.y, at.point.z};
    std::copy(std::begin(row), std::end(row), found.mutable_data(k, 0));
  }
  return found;
}

int add_shape(World& w, int link, Vec3 position, const Rot3& rotation, Vec3 lo, Vec3 hi, bool half_space,
              Vec3 normal, double offset, double friction, const std::shared_ptr<Surface>& surface,
              const std::shared_ptr<SignedDistance>& solid, const std::optional<Primitive>& primitive) {
  Shape s;
  s.link = link;
  s.local = {rotation, position};
  s.lo = lo;
  s.hi = hi;
  s.half_space = half_space;
  s.plane_normal = normal;
  s.plane_offset = offset;
  s.friction = friction;
  s.surface = surface;
  s.solid = solid;
  if (primitive) s.primitive = *primitive;
  return w.add_shape(s);
}

// centres, slopes (2, 3), in the link's frame.
void set_mouths(World& w, int slot, const std::vector<Vec3>& centres, const std::vector<Vec3>& slopes) {
  w.set_mouths(slot, {centres[0], centres[1]}, {slopes[0], slopes[1]});
}

// points (k, 3), in the link's frame.
py::array_t<bool> is_drilled(const World& w, int slot, const std::vector<Vec3>& points) {
  const Bore bore = w.scene.bore_in_link(slot);
  py::array_t<bool> found(points.size());
  for (size_t i = 0; i < points.size(); ++i) found.mutable_at(i) = bore.removes(points[i]);
  return found;
}

// (contacts, 14)
std::vector<std::array<double, 14>> contacts(const World& w) {
  std::vector<std::array<double, 14>> out;
  for (size_t i = 0; i < w.contact_count(); ++i) out.push_back(row_of(w, w.contact(i)));
  return out;
}

// Depth of the deepest contact that has a normal force, in radii of its tendon [-].
double pressed_depth(const World& w) {
  double most = 0;
  for (size_t i = 0; i < w.contact_count(); ++i) {
    const Contact& c = w.contact(i);
    if (c.normal_force.value > 0) most = std::max(most, -c.distance() / w.scene.tendons[c.a.tendon]->radius);
  }
  return most;
}

}  // namespace

void bind_collision(py::module_& m, GuardedWorld& world) {
  py::class_<Surface, std::shared_ptr<Surface>>(m, "Surface")
      .def(py::init<const std::vector<Triangle>&>())
      .def("crossed", &crossed)
      .def("nearest", &nearest_to);
  py::class_<Primitive>(m, "Primitive")
      .def(py::init(&primitive_of))
      .def_property_readonly("corner", &corner_of)
      .def("__call__", &measured_along)
      .def("round_at", [](const Primitive& shape, Vec3 point, Vec3 normal) {
        const Primitive::Round round = shape.round_at(point, normal);
        return py::make_tuple(round.radius, round.axis);
      });
  world.def("add_shape", &add_shape)
      .def("remove_shape", &World::remove_shape)
      .def("add_tunnel", [](World& w, int link, Vec3 start, Vec3 end, double radius, double chamfer,
                            double mu) { return w.add_tunnel({link, start, end, radius, chamfer, mu}); })
      .def("set_mouths", &set_mouths)
      .def("is_drilled", &is_drilled)
      .def("remove_tunnel", &World::remove_tunnel)
      .def("forget_contacts", &World::forget_contacts)
      .def("set_collides",
           [](World& w, int c, bool collides) {
             w.filter_contacts({c}, [&](CollisionFilter& f) { f.set_inert(c, !collides); });
           })
      .def("set_tendons_collide",
           [](World& w, int a, int b, bool collide) {
             w.filter_contacts({a, b}, [&](CollisionFilter& f) { f.set_tendons(a, b, collide); });
           })
      .def("set_link_collides",
           [](World& w, int c, int link, bool collides) {
             w.filter_contacts({c}, [&](CollisionFilter& f) { f.set_link(c, link, collides); });
           })
      .def("collides", [](World& w, int c) { return !w.scene.filter.is_inert(c); })
      .def("link_collides", [](World& w, int c, int link) { return w.scene.filter.meets_link(c, link); })
      .def("contacts", &contacts)
      .def("pressed_depth", &pressed_depth);
}

}  // namespace bt
