// Python's access to steps, states and reports.
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "bindings/arrays.h"

namespace bt {

namespace {

// Distances that Python measures, by FCL: measure(shape, a, b) -> (distance, points, u), of queries by shape
// number and ends (q, 3) [m] in the shape's frame.
class PythonOracle : public DistanceOracle {
 public:
  explicit PythonOracle(py::handle measure) : measure_(measure) {}

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
  py::handle measure_;  // the caller keeps it
  std::vector<Vec3> a_, b_;
  std::vector<int> shape_;
};

// The interpreter runs other threads meanwhile: what py::gil_scoped_release does, in half of the time.
struct Unlocked {
  PyThreadState* state = PyEval_SaveThread();
  Unlocked() = default;
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;
  ~Unlocked() { PyEval_RestoreThread(state); }
};

// The step alone. Whether it was solved.
bool step(World& w, double dt, const py::tuple& gravity, bool whole, const py::object& measure) {
  const Vec3 g = vector(gravity.ptr());
  PythonOracle oracle(measure);
  Unlocked unlocked;
  return w.step(dt, g, whole, oracle);
}

// sense(dt, gravity, whole) reads the bodies, before the step; None: there are none. The interpreter is given
// to other threads only after that: every time it is given away, this thread waits for it again.
bool attempt(World& w, double dt, Vec3 gravity, bool whole, const py::object& sense,
             const py::object& measure) {
  PythonOracle oracle(measure);
  std::optional<Unlocked> unlocked;
  std::function<void()> read;
  if (sense.is_none())
    unlocked.emplace();
  else
    read = [&] {
      sense(dt, tuple(gravity), whole);
      unlocked.emplace();
    };
  return w.attempt(dt, gravity, whole, oracle, read);
}

// Result of `apply`.
// kSolvedToTell: the report names what has to be warned of.
enum Outcome { kFailed = 0, kSolved = 1, kSolvedToTell = 2, kBadParameters = 3 };

// A step of p.getPhysicsEngineParameters' length and gravity.
int apply(World& w, const py::dict& parameters, const py::object& sense, const py::object& measure) {
  static const std::array<py::handle, 4> names = [] {
    std::array<py::handle, 4> keys;
    const char* const text[] = {"fixedTimeStep", "gravityAccelerationX", "gravityAccelerationY",
                                "gravityAccelerationZ"};
    for (size_t k = 0; k < keys.size(); ++k) keys[k] = PyUnicode_InternFromString(text[k]);
    return keys;
  }();
  double values[4];
  for (size_t k = 0; k < names.size(); ++k) {
    PyObject* value = PyDict_GetItemWithError(parameters.ptr(), names[k].ptr());
    if (!value) throw py::key_error("physics engine parameters");
    values[k] = PyFloat_AsDouble(value);
    if (values[k] == -1 && PyErr_Occurred()) throw py::error_already_set();
    if (!std::isfinite(values[k])) return kBadParameters;
  }
  if (!(values[0] > 0)) return kBadParameters;
  if (!attempt(w, values[0], {values[1], values[2], values[3]}, false, sense, measure)) return kFailed;
  return w.report().coarse_tendon < 0 && w.report().flat_cartilage < 0 ? kSolved : kSolvedToTell;
}

// A step of another length, which is not divided, and in which bodies neither move nor yield.
bool hold(World& w, double dt, const py::tuple& gravity, const py::object& sense, const py::object& measure) {
  return attempt(w, dt, vector(gravity.ptr()), true, sense, measure);
}

// (6 k, 6 k); None where the last step that held the bodies has not found it.
py::object tendon_stiffness(const World& w) {
  const TendonStiffness& found = w.stiffness;
  if (!found.known) return py::none();
  const auto n = static_cast<py::ssize_t>(6 * found.links.size());
  return Array({n, n}, found.matrix.data());
}

py::dict counts(const Report& r) {
  py::dict d;
  d["pairs_considered"] = r.near.considered;
  d["pairs_culled"] = r.near.culled;
  d["pairs_skipped"] = r.near.skipped;
  d["pairs_reused"] = r.near.reused;
  d["pairs_searched"] = r.near.searched;
  d["pairs_queried"] = r.near.queried;
  d["tunnels_considered"] = r.near.tunnels;
  d["tunnels_culled"] = r.near.tunnels_culled;
  d["tendon_searches"] = r.pairs.searches;
  d["tendon_searches_skipped"] = r.pairs.skipped;
  d["tendon_pairs_considered"] = r.pairs.considered;
  d["tendon_pairs_near"] = r.pairs.near;
  d["contacts"] = r.contacts;
  d["islands"] = r.islands;
  d["substeps"] = r.substeps;
  d["tendons_asleep"] = r.asleep;
  d["linear_solves"] = r.linear_solves;
  return d;
}

void set_options(World& w, int integrator, int iteration, int linear_solver, int bone_contact,
                 double tolerance, int max_iterations, double linear_tolerance, double contact_stiffness,
                 double contact_threshold, double reuse_tolerance, bool sleep, long max_linear_solves,
                 double time_budget) {
  w.wake_all();
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

void append(std::vector<float>& out, Vec3 v) {
  for (double part : {v.x, v.y, v.z}) out.push_back(static_cast<float>(part));
}

// What a recorder keeps of a moment, in one object, which costs least. It has blocks, each the number of its
// floats (int32) and these (float32): of all tendons by slot, positions (n, 3) and tension (n-1), one after
// the other; energies (tendons); anchors (a, 6): tendon, particle, link (-1: a grip), force; contacts (c,
// 14), by row_of; and ligaments (l, 2): slot, force.
py::bytes moment(const World& w) {
  std::vector<float> shapes, energies, anchors, contacts, ligaments;
  std::vector<double> tension;
  shapes.reserve(1024);
  contacts.reserve(1024);
  for (size_t slot = 0; slot < w.scene.tendons.size(); ++slot) {
    const Tendon* tendon = w.scene.tendons[slot].get();
    if (!tendon) continue;
    for (int i = 0; i < tendon->x.size(); ++i) append(shapes, tendon->x.at(i));
    tendon->tension(tension);
    shapes.insert(shapes.end(), tension.begin(), tension.end());
    energies.push_back(static_cast<float>(tendon->energy()));
    for (const Anchor& anchor : tendon->anchors) {
      for (int number : {static_cast<int>(slot), anchor.particle, anchor.link})
        anchors.push_back(static_cast<float>(number));
      append(anchors, anchor.step_force);
    }
  }
  for (const ContactRecord& c : w.contacts())
    for (double value : row_of(c)) contacts.push_back(static_cast<float>(value));
  const auto& all = w.scene.ligaments;
  for (size_t slot = 0; slot < all.size(); ++slot)
    if (all[slot])
      ligaments.insert(ligaments.end(), {static_cast<float>(slot), static_cast<float>(all[slot]->force)});
  std::string out;
  for (const auto* block : {&shapes, &energies, &anchors, &contacts, &ligaments}) {
    const auto count = static_cast<int32_t>(block->size());
    out.append(reinterpret_cast<const char*>(&count), sizeof count);
    out.append(reinterpret_cast<const char*>(block->data()), block->size() * sizeof(float));
  }
  return out;
}

}  // namespace

void bind_world_world(GuardedWorld& world) {
  world.def("moment", &moment);
  world.def("set_options", &set_options)
      .def("step", &step)
      .def("apply", &apply)
      .def("hold", &hold)
      .def("want_tendon_stiffness",
           [](World& w, const std::vector<int>& links) { w.stiffness = {links, {}, false}; })
      .def("tendon_stiffness", &tendon_stiffness)
      .def("coarse_turn",
           [](World& w, int tendon) {
             CoarseTurn& of = w.scene.tendons.at(tendon)->coarse;
             of.reported = true;
             return py::make_tuple(of.particle, of.link, of.angle);
           })
      .def("last_step",
           [](const World& w) { return py::make_tuple(w.last_step().dt, tuple(w.last_step().gravity)); })
      .def("save",
           [](World& w) {
             std::vector<char> state = w.save();
             return py::bytes(state.data(), state.size());
           })
      .def("restore", [](World& w, std::string_view state) { w.restore(state.data(), state.size()); })
      .def("report", [](const World& w) { return w.report(); });
}

void bind_report(py::module_& m) {
  py::class_<Report>(m, "Report")
      .def_readonly("iterations", &Report::iterations)
      .def_readonly("residual", &Report::residual)
      .def_readonly("converged", &Report::converged)
      .def_readonly("worst_tendon", &Report::worst_tendon)
      .def_readonly("worst_particle", &Report::worst_particle)
      .def_readonly("sense_seconds", &Report::sense_seconds)
      .def_readonly("near_seconds", &Report::near_seconds)
      .def_readonly("solve_seconds", &Report::solve_seconds)
      .def_readonly("search_seconds", &Report::search_seconds)
      .def_readonly("over_budget", &Report::over_budget)
      .def_readonly("coarse_tendon", &Report::coarse_tendon)
      .def_readonly("flat_cartilage", &Report::flat_cartilage)
      .def_property_readonly(
          "reasons", [](const Report& r) { return std::vector<int>(r.reasons.begin(), r.reasons.end()); })
      .def("counts", &counts);
}

}  // namespace bt
