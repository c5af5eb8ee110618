// The Python face of the core (module bullet_tendon._core): arrays in, arrays out, no logic.
// Python validates before it calls; nothing here is public.
#include "bindings.h"

#include <pybind11/stl.h>

#include "allocations.h"
#include "body_constants.h"
#include "told.h"

using namespace bt;

namespace {

int add_chain(World& w, const Array& points, double radius, double friction, double stiffness,
              double exponent, double toe_strain, bool tension_only, double damping, double damping_exponent,
              bool whole_velocity, double shear_stiffness, double bending_stiffness, double linear_density) {
  Material m;
  m.law = {exponent, toe_strain, tension_only, damping_exponent, whole_velocity};
  m.stiffness = stiffness, m.damping = damping, m.shear_stiffness = shear_stiffness;
  m.bending_stiffness = bending_stiffness;
  m.linear_density = linear_density;
  std::vector<Vec3> p(points.shape(0));
  for (size_t i = 0; i < p.size(); ++i) p[i] = vec(points.data() + 3 * i);
  return w.add_chain(std::make_unique<Chain>(p, radius, friction, m));
}

// A tendon about which something is going to change.
Chain& stirred(World& w, int chain) {
  w.rouse(chain);
  return *w.chains[chain];
}

Hold& hold_of(World& w, int chain, int id) {
  for (Hold& h : w.chains[chain]->holds)
    if (h.id == id) return h;
  throw py::key_error("no such hold");
}

void remove_hold(World& w, int chain, int id) {
  auto& holds = stirred(w, chain).holds;
  w.chains[chain]->smooth = false;
  holds.erase(std::remove_if(holds.begin(), holds.end(), [&](const Hold& h) { return h.id == id; }),
              holds.end());
}

void set_grip(World& w, int chain, int id, const Array& target, double stiffness, double viscosity) {
  Hold& h = hold_of(w, chain, id);
  const Vec3 goal = vec(target);
  if (norm(goal - h.goal) > 0 || h.stiffness.xx != stiffness || h.viscosity != viscosity) w.rouse(chain);
  h.goal = goal;
  h.rigid = stiffness <= 0;
  h.stiffness = identity(stiffness), h.viscosity = viscosity;
}

int add_shape(World& w, int link, const Array& position, const Array& rot, const Array& lo, const Array& hi,
              bool half_space, const Array& normal, double offset, double friction, const Array& triangles,
              const std::optional<Primitive>& primitive) {
  Shape s;
  s.link = link, s.local = {rotation(rot.data()), vec(position)}, s.lo = vec(lo), s.hi = vec(hi);
  s.half_space = half_space, s.plane_normal = vec(normal), s.plane_offset = offset, s.friction = friction;
  if (triangles.size() > 0) s.surface = std::make_shared<Surface>(triangles_of(triangles));
  if (primitive) s.primitive = *primitive;
  return w.add_shape(s);
}

// Distances that Python measures, by FCL: measure(shape, a, b) -> (distance, points, u), of queries by shape
// number and ends (q, 3) [m] in the shape's frame. The interpreter is locked in it alone.
class PythonOracle : public DistanceOracle {
 public:
  explicit PythonOracle(py::object measure) : measure_(std::move(measure)) {}
  ~PythonOracle() override {
    py::gil_scoped_acquire lock;
    measure_ = {};
  }

  void measure(const std::vector<Query>& queries, std::vector<double>& distance, std::vector<double>& points,
               std::vector<double>& u) override {
    py::gil_scoped_acquire lock;
    a_.clear();
    b_.clear();
    shape_.clear();
    for (const Query& q : queries) {
      a_.push_back(q.a);
      b_.push_back(q.b);
      shape_.push_back(q.shape);
    }
    const Ints shape(static_cast<py::ssize_t>(shape_.size()), shape_.data());
    const py::tuple found = measure_(shape, rows_of(a_), rows_of(b_));
    distance = list_of(found[0].cast<Array>());
    points = list_of(found[1].cast<Array>());
    u = list_of(found[2].cast<Array>());
    const size_t n = queries.size();
    if (distance.size() != n || points.size() != 3 * n || u.size() != n)
      throw std::length_error("distances of another number of queries");
  }

  // Ctrl-C ends the step.
  void poll() override {
    py::gil_scoped_acquire lock;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }

 private:
  py::object measure_;
  std::vector<Vec3> a_, b_;
  std::vector<int> shape_;
};

// One step: whether it was solved, and the seconds of wall time of distances and of the rest.
py::tuple step(World& w, double dt, const py::tuple& gravity, bool whole, py::object measure) {
  const Vec3 g = vector(gravity.ptr());
  PythonOracle oracle(std::move(measure));
  StepOutcome out;
  {
    py::gil_scoped_release release;
    out = w.step(dt, g, whole, oracle);
  }
  return py::make_tuple(out.solved, out.near_seconds, out.solve_seconds);
}

Array wrenches(const World& w) {
  Array out({static_cast<py::ssize_t>(w.links.size()), static_cast<py::ssize_t>(6)});
  double* p = out.mutable_data();
  for (const Link& l : w.links) {
    *p++ = l.force.x, *p++ = l.force.y, *p++ = l.force.z;
    *p++ = l.torque.x, *p++ = l.torque.y, *p++ = l.torque.z;
  }
  return out;
}

// Slot, force, its point and the torque about that of the links that answer to one; None for a torque where
// the force is all, as of one attachment.
py::list pushes(const World& w) {
  py::list out;
  for (std::size_t i = 0; i < w.links.size(); ++i) {
    const Link& l = w.links[i];
    const double force = norm(l.force), torque = norm(l.torque);
    const Vec3 centre = l.turned.far ? l.start_centre : l.centre;
    if (!l.yields() || !(force > 0 || torque > 0)) continue;
    if (std::fabs(dot(l.force, l.torque)) <= kAcross * force * torque && force > 0) {
      const Vec3 point = centre + (1 / (force * force)) * cross(l.force, l.torque);
      out.append(py::make_tuple(i, tuple(l.force), tuple(point), py::none()));
    } else {
      out.append(py::make_tuple(i, tuple(l.force), tuple(centre), tuple(l.torque)));
    }
  }
  return out;
}

py::dict counts(const Report& r) {
  py::dict d;
  d["pairs_considered"] = r.near.considered, d["pairs_culled"] = r.near.culled;
  d["pairs_skipped"] = r.near.skipped, d["pairs_reused"] = r.near.reused;
  d["pairs_searched"] = r.near.searched, d["pairs_queried"] = r.near.queried;
  d["tunnels_considered"] = r.near.tunnels, d["tunnels_culled"] = r.near.tunnels_culled;
  d["tendon_searches"] = r.pairs.searches, d["tendon_searches_skipped"] = r.pairs.skipped;
  d["tendon_pairs_considered"] = r.pairs.considered, d["tendon_pairs_near"] = r.pairs.near;
  d["rows"] = r.rows, d["groups"] = r.groups, d["substeps"] = r.substeps;
  d["tendons_asleep"] = r.asleep;
  d["linear_solves"] = r.linear_solves;
  return d;
}

py::list contacts(const World& w) {
  py::list out;
  for (const ContactRecord& c : w.contacts())
    out.append(py::make_tuple(c.chain, c.segment, c.other_chain, c.link, static_cast<int>(c.kind),
                              tuple(c.position), tuple(c.normal), c.distance, c.normal_force,
                              c.friction_force));
  return out;
}

void set_options(World& w, int integrator, int iteration, int linear_solver, int bone_contact,
                 double tolerance, int max_iterations, double linear_tolerance, double contact_stiffness,
                 double contact_threshold, double reuse_tolerance, bool sleep, long max_linear_solves,
                 double time_budget) {
  w.rouse_all();
  w.options = {static_cast<Integrator>(integrator),
               static_cast<Iteration>(iteration),
               static_cast<LinearSolver>(linear_solver),
               static_cast<BoneContact>(bone_contact),
               tolerance,
               max_iterations,
               linear_tolerance,
               contact_stiffness,
               contact_threshold,
               reuse_tolerance,
               sleep,
               max_linear_solves,
               time_budget};
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  m.doc() = "Compiled core of bullet_tendon: mechanics, contact and time stepping.";
  m.def("allocated_bytes", &allocated_bytes);
  m.attr("CUT_OFF_RATE") = kCutOff * kMostRate;
  py::class_<World> world_class(m, "World");
  GuardedWorld world(world_class);
  py::class_<Report>(m, "Report")
      .def_readonly("iterations", &Report::iterations)
      .def_readonly("residual", &Report::residual)
      .def_readonly("converged", &Report::converged)
      .def_readonly("worst_chain", &Report::worst_chain)
      .def_readonly("worst_particle", &Report::worst_particle)
      .def_readonly("search_seconds", &Report::search_seconds)
      .def_readonly("over_budget", &Report::over_budget)
      .def_property_readonly(
          "reasons", [](const Report& r) { return std::vector<int>(r.reasons.begin(), r.reasons.end()); })
      .def("counts", &counts);
  bind_articulated(m);
  bind_links(m, world);
  bind_bodies(m, world);
  bind_primitives(m);
  py::module_ testing = m.def_submodule("testing", "What only tests call.");
  bind_terms(testing);
  bind_sparse(testing);
  bind_pairs(testing);
  testing.def("watch_substeps", [](World& w, py::object callback) {
    w.after_substep = [callback = std::move(callback)] {
      py::gil_scoped_acquire lock;
      callback();
    };
  });
  world_class.def(py::init<>());
  world.def("set_options", &set_options)
      .def("add_chain", &add_chain)
      .def("remove_chain", &World::remove_chain)
      .def("positions", [](World& w, int c) { return rows_of(w.chains[c]->x); })
      .def("velocities", [](World& w, int c) { return rows_of(w.chains[c]->v); })
      .def("set_state",
           [](World& w, int c, const Array& x, const Array& v) {
             Chain& chain = stirred(w, c);
             fill(chain.x, x), fill(chain.v, v);
             chain.spread_coincident();
             chain.find_overlaid();
             chain.reset_history();
           })
      .def("stop", [](World& w, int c) { stirred(w, c).stop(); })
      .def("guess_multipliers",
           [](World& w, int c, const Array& g) { stirred(w, c).guess_multipliers(vec(g)); })
      .def("masses", [](World& w, int c) { return copy_of(w.chains[c]->mass); })
      .def("rest", [](World& w, int c) { return copy_of(w.chains[c]->rest); })
      .def("set_rest", [](World& w, int c, const Array& rest) { stirred(w, c).set_rest(list_of(rest)); })
      .def("set_point_mass",
           [](World& w, int c, int i, double m) {
             stirred(w, c).set_point_mass(i, m);
             w.chains[c]->smooth = false;
           })
      .def("set_stiffness_scale",
           [](World& w, int c, const Array& scale) { stirred(w, c).set_stiffness_scale(list_of(scale)); })
      .def("tension",
           [](World& w, int c) {
             std::vector<double> t;
             w.chains[c]->tension(t);
             return copy_of(t);
           })
      .def("is_asleep", [](World& w, int c) { return w.chains[c]->bed >= 0; })
      .def("energy", [](World& w, int c) { return w.chains[c]->energy(); })
      .def("tunnel_of", [](World& w, int c) { return w.chains[c]->tunnel_of; })
      .def("set_force", [](World& w, int c, int i, const Array& f) { stirred(w, c).force.set(i, vec(f)); })
      .def("force", [](World& w, int c, int i) { return tuple(w.chains[c]->force.at(i)); })
      .def("add_grip",
           [](World& w, int c, int id, int particle) {
             Hold h;
             h.id = id, h.particle = particle;
             stirred(w, c).holds.push_back(h);
             w.chains[c]->smooth = false;
           })
      .def("set_grip", &set_grip)
      .def("add_attachment",
           [](World& w, int c, int id, int particle, int link, const Array& local) {
             Hold h;
             h.id = id, h.particle = particle, h.link = link, h.local = vec(local);
             stirred(w, c).holds.push_back(h);
             w.chains[c]->smooth = false;
           })
      .def("set_clamp",
           [](World& w, int c, int id, const Array& direction) {
             Hold& h = hold_of(w, c, id);
             w.rouse(c);
             h.clamped = true, h.direction = vec(direction);
           })
      .def("remove_hold", &remove_hold)
      .def("hold_force", [](World& w, int c, int id) { return tuple(hold_of(w, c, id).step_force); })
      .def("sense",
           [](World& w, double dt, const py::tuple& gravity, bool held) {
             w.sense(dt, vector(gravity.ptr()), held);
             return w.any_held() || !w.released_movers().empty() || !w.pulled_movers().empty();
           })
      .def("released_movers", &World::released_movers)
      .def("rewind",
           [](World& w, double dt, const py::tuple& gravity, const std::vector<int>& pulled) {
             return w.rewind(dt, vector(gravity.ptr()), pulled);
           })
      .def("pulled_movers", &World::pulled_movers)
      .def("keep_told_contacts", &World::keep_told_contacts)
      .def("any_held", &World::any_held)
      .def("held_movers",
           [](const World& w) {
             std::vector<int> held;
             for (size_t i = 0; i < w.movers.size(); ++i)
               if (w.movers[i].observer.held() && !w.movers[i].observer.released())
                 held.push_back(static_cast<int>(i));
             return held;
           })
      .def("let_go", &World::let_go)
      .def("stopped", [](const World& w, int link) { return w.movers[w.links[link].mover].stopped(); })
      .def("missed", [](const World& w, int mover) { return copy_of(w.movers[mover].observer.missed()); })
      .def("was_cut", [](const World& w, int mover) { return w.movers[mover].observer.was_cut(); })
      .def("pushable",
           [](const World& w) {
             std::vector<int> free;
             for (size_t i = 0; i < w.links.size(); ++i)
               if (w.links[i].yields() && !w.movers[w.links[i].mover].observer.held())
                 free.push_back(static_cast<int>(i));
             return free;
           })
      .def("refresh_movers", &World::refresh_movers)
      .def("add_shape", &add_shape)
      .def("remove_shape", &World::remove_shape)
      .def("add_tunnel",
           [](World& w, int link, const Array& start, const Array& end, double radius, double chamfer,
              double mu) { return w.add_tunnel({link, vec(start), vec(end), radius, chamfer, mu}); })
      .def("remove_tunnel", &World::remove_tunnel)
      .def("forget_contacts", &World::forget_contacts)
      .def("step", &step)
      .def("checkpoint", &World::checkpoint)
      .def("restore_checkpoint", &World::restore_checkpoint)
      .def("save",
           [](World& w) {
             std::vector<char> state = w.save();
             return py::bytes(state.data(), state.size());
           })
      .def("restore", [](World& w, std::string_view state) { w.restore(state.data(), state.size()); })
      .def("wrenches", &wrenches)
      .def("pushes", &pushes)
      .def("report", [](const World& w) { return w.report(); })
      .def("contacts", &contacts);
}
