// Python's access to steps, states and reports.
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "bindings/arrays.h"
#include "world/checkpoint.h"

namespace bt {

namespace {

// Distances that Python measures, by FCL: measure(shape, a, b) -> (distance, points, u), of queries by shape
// number and ends (q, 3) [m] in the shape's frame.
class PythonOracle : public DistanceOracle {
 public:
  explicit PythonOracle(py::handle measure) : measure_(measure) {}

  void measure(const std::vector<Query>& queries, std::vector<double>& distance, std::vector<Vec3>& points,
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
    const py::tuple found = measure_(shape, a_, b_);
    distance = found[0].cast<std::vector<double>>();
    points = found[1].cast<std::vector<Vec3>>();
    u = found[2].cast<std::vector<double>>();
    const size_t n = queries.size();
    if (distance.size() != n || points.size() != n || u.size() != n)
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
bool step(World& w, double dt, Vec3 gravity, bool whole, const py::object& measure) {
  PythonOracle oracle(measure);
  Unlocked unlocked;
  return w.step(dt, gravity, whole, oracle);
}

// sense(dt, gravity) reads the bodies, before the step; None: there are none. The interpreter is given to
// other threads only after that: every time it is given away, this thread waits for it again.
bool attempt(World& w, double dt, Vec3 gravity, const py::object& sense, const py::object& measure) {
  PythonOracle oracle(measure);
  std::optional<Unlocked> unlocked;
  std::function<void()> read;
  if (sense.is_none())
    unlocked.emplace();
  else
    read = [&] {
      sense(dt, gravity);
      unlocked.emplace();
    };
  return w.attempt(dt, gravity, false, oracle, read);
}

// Result of `apply`.
// kSolvedToTell: the report names what has to be warned of.
enum Outcome { kFailed = 0, kSolved = 1, kSolvedToTell = 2, kBadParameters = 3 };

// A step of p.getPhysicsEngineParameters' length and gravity. Every step asks: its names are made once.
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
  if (!attempt(w, values[0], {values[1], values[2], values[3]}, sense, measure)) return kFailed;
  return w.report().coarse_tendon < 0 && w.report().flat_cartilage < 0 ? kSolved : kSolvedToTell;
}

// A step of another length, which is not divided, and in which bodies neither move nor yield. They are where
// they were read last.
bool hold(World& w, double dt, Vec3 gravity, double at_hand, const py::object& measure) {
  PythonOracle oracle(measure);
  Unlocked unlocked;
  return w.hold(dt, gravity, at_hand, oracle);
}

// (6 k, m); None where the last step that held the bodies has not found it.
py::object by_twists(const World& w, const dense::Numbers& found) {
  if (!w.stiffness.known) return py::none();
  const auto n = static_cast<py::ssize_t>(6 * w.stiffness.links.size());
  return Array({n, static_cast<py::ssize_t>(found.size()) / n}, found.data());
}

// By link, of twists (k, 6) of the links of these slots.
std::vector<Twist> twists_of(const World& w, const std::vector<int>& slots, const Array& twists) {
  std::vector<Twist> of(w.scene.links.size());
  for (size_t i = 0; i < slots.size(); ++i)
    of.at(slots[i]) = {vec(twists.data() + 6 * i), vec(twists.data() + 6 * i + 3)};
  return of;
}

// motion: of all particles, empty where none act on the bodies.
double safe_share(World& w, const std::vector<int>& slots, const Array& twists, const Array& motion,
                  const py::object& measure) {
  PythonOracle oracle(measure);
  const std::vector<Twist> of = twists_of(w, slots, twists);
  Unlocked unlocked;
  return w.safe_share(of, motion.size() > 0 ? motion.data() : nullptr, oracle);
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

// Where a state of p.getLinkStates has position and orientation of the URDF frame.
constexpr int kLinkFrame = 4;

// A position and an orientation, which are the items from `first` on.
void add_pose(std::vector<double>& out, PyObject* found, int first) {
  if (!found) throw py::value_error("links");  // pybullet has returned the states of fewer links
  for (int part = 0; part < 2; ++part)
    for (int i = 0; i < 3 + part; ++i) out.push_back(number(item(found, first + part), i));
}

// What a recorder keeps of a moment (`moment`).
struct Moment {
  std::vector<std::int32_t> counts;  // of the numbers of each block
  std::vector<float> numbers;        // of all blocks but the last one, one after the other
  std::vector<double> poses;

  template <class List>
  void add(const List& more) {
    numbers.insert(numbers.end(), more.begin(), more.end());
  }
  void end_block() {
    const auto all = static_cast<std::int32_t>(numbers.size());
    counts.push_back(all - std::accumulate(counts.begin(), counts.end(), 0));
  }
};

void read_parts(const World& w, Moment& to) {
  static thread_local std::vector<double> tension;  // keeps its memory from call to call
  for (auto [slot, tendon] : filled(w.scene.tendons)) {
    for (int i = 0; i < tendon.n(); ++i) {
      const Vec3 x = tendon.x.at(i);
      to.add(std::array{x.x, x.y, x.z});
    }
    tendon.tension(tension);
    to.add(tension);
  }
  to.end_block();
  for (auto [slot, tendon] : filled(w.scene.tendons)) to.add(std::array{tendon.energy()});
  to.end_block();
  for (auto [slot, tendon] : filled(w.scene.tendons))
    for (const Anchor& h : tendon.anchors) {
      const Vec3 f = h.force.read;
      to.add(std::array{double(slot), double(h.particle), double(h.link), f.x, f.y, f.z});
    }
  to.end_block();
  for (size_t i = 0; i < w.contact_count(); ++i) to.add(row_of(w, w.contact(i)));
  to.end_block();
  for (auto [slot, ligament] : filled(w.scene.ligaments)) to.add(std::array{double(slot), ligament.force});
  to.end_block();
}

// Writes what a recorder keeps of a moment into `memory` from the byte `start` on. Returns its end; where it
// is too long for that, less 0, its size. First the counts of the blocks' numbers (6, int32), then the blocks
// (float32): of all tendons by slot, positions (n, 3) and tension (n-1), one after the other; energies
// (tendons); anchors (a, 6): tendon, particle, link (-1: a grip), force; contacts (c, 14), by row_of;
// ligaments (l, 2): slot, force; and the poses (p, 7, float64) of bases and then of links.
//
// bases: slot or -1, and arguments of `ask`, p.getBasePositionAndOrientation. at_once: what stands has not
// been moved since it was read for the last step. links: what p.getLinkStates has returned.
py::ssize_t moment(const World& w, py::array_t<std::uint8_t>& memory, py::ssize_t start, bool at_once,
                   const py::list& bases, const py::object& ask, const py::list& links) {
  static thread_local Moment found;  // keeps its memory from call to call
  found.counts.clear();
  found.numbers.clear();
  found.poses.clear();
  for (const py::handle base : bases) {
    const int slot = static_cast<int>(number(base.ptr(), 0));
    if (at_once && slot >= 0 && slot < static_cast<int>(w.standing.size()) && w.standing[slot])
      found.poses.insert(found.poses.end(), w.standing[slot]->begin(), w.standing[slot]->end());
    else
      add_pose(found.poses, ask(*py::reinterpret_borrow<py::tuple>(item(base.ptr(), 1))).ptr(), 0);
  }
  for (const py::handle link : links) add_pose(found.poses, link.ptr(), kLinkFrame);
  read_parts(w, found);
  found.counts.push_back(static_cast<std::int32_t>(found.poses.size()));
  const auto size =
      static_cast<py::ssize_t>(sizeof(std::int32_t) * found.counts.size() +
                               sizeof(float) * found.numbers.size() + sizeof(double) * found.poses.size());
  if (start < 0 || start + size > memory.size()) return -size;
  std::uint8_t* at = memory.mutable_data() + start;
  auto write = [&at](const auto& list) {
    const size_t of_list = sizeof(list[0]) * list.size();
    if (of_list > 0) std::memcpy(at, list.data(), of_list);
    at += of_list;
  };
  write(found.counts);
  write(found.numbers);
  write(found.poses);
  return start + size;
}

}  // namespace

void bind_steps(py::module_& m, GuardedWorld& world) {
  py::class_<Checkpoint, std::shared_ptr<Checkpoint>>(m, "Checkpoint");
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
      .def_readonly("stops_settled", &Report::stops_settled)
      .def_readonly("coarse_tendon", &Report::coarse_tendon)
      .def_readonly("flat_cartilage", &Report::flat_cartilage)
      .def_property_readonly(
          "reasons", [](const Report& r) { return std::vector<int>(r.reasons.begin(), r.reasons.end()); })
      .def("counts", &counts);
  world.def("moment", &moment);
  world.def("set_options", &set_options)
      .def("step", &step)
      .def("apply", &apply)
      .def("hold", &hold)
      .def("want_tendon_stiffness", [](World& w, const std::vector<int>& links) { w.stiffness = {links}; })
      .def("tendon_stiffness", [](const World& w) { return by_twists(w, w.stiffness.matrix); })
      .def("tendon_motion", [](const World& w) { return by_twists(w, w.stiffness.motion); })
      .def("safe_share", &safe_share)
      .def("carry_tendons", [](World& w, const Array& motion) { w.carry_tendons(motion.data()); })
      .def("coarse_turn",
           [](World& w, int tendon) {
             CoarseTurn& of = w.scene.tendons.at(tendon)->coarse;
             of.reported = true;
             return py::make_tuple(of.particle, of.link, of.other, of.angle, of.sliding, of.winding, of.bent,
                                   of.friction);
           })
      .def("last_step",
           [](const World& w) { return py::make_tuple(w.last_step().dt, w.last_step().gravity); })
      .def("save",
           [](World& w) {
             std::vector<char> state = w.save();
             return py::bytes(state.data(), state.size());
           })
      .def("restore", [](World& w, std::string_view state) { w.restore(state.data(), state.size()); })
      .def("checkpoint", &World::checkpoint)
      .def("capture", &World::capture)
      .def("return_to", &World::return_to)
      .def("report", [](const World& w) { return w.report(); });
}

}  // namespace bt
