// The search for tendons that touch, by itself, for tests.
#include <pybind11/stl.h>

#include "bindings.h"

namespace bt {

namespace {

struct Probe {
  std::vector<Chain> chains;
  BroadPhase search;

  void add(const Array& points, double radius) {
    std::vector<Vec3> p(points.shape(0));
    for (size_t i = 0; i < p.size(); ++i) p[i] = vec(points.data() + 3 * i);
    Material material;
    material.law = {1, 1e300, false, 1, false};
    material.stiffness = 1;
    material.linear_density = 1;
    chains.emplace_back(p, radius, 0.0, material);
    search.clear();
  }

  // Tendons at x that are foreseen to be at `ahead`: rows of tendon, segment, tendon, segment, u, w and
  // distance; and how many lists were collected and served again. swept: where tendons approach
  // (narrow_phase.h).
  py::tuple find(const std::vector<Array>& x, const std::vector<Array>& ahead, bool swept) {
    std::vector<Chain*> slots;
    for (size_t c = 0; c < chains.size(); ++c) {
      fill(chains[c].x, x[c]);
      fill(chains[c].next, ahead[c]);
      chains[c].foresee();
      slots.push_back(&chains[c]);
    }
    std::vector<SegmentPair> found;
    const Foresight foresight = swept ? Foresight::swept : Foresight::near;
    const PairCounts counts = search.find(slots, 0, foresight, found);
    Array rows({static_cast<py::ssize_t>(found.size()), static_cast<py::ssize_t>(7)});
    double* to = rows.mutable_data();
    for (const SegmentPair& s : found)
      for (const double value :
           {static_cast<double>(s.chain_a), static_cast<double>(s.segment_a), static_cast<double>(s.chain_b),
            static_cast<double>(s.segment_b), s.u, s.w, s.distance})
        *to++ = value;
    return py::make_tuple(rows, counts.searches, counts.skipped);
  }
};

}  // namespace

void bind_pairs(py::module_& testing) {
  py::class_<Probe>(testing, "BroadPhase")
      .def(py::init<>())
      .def("add", &Probe::add)
      .def("find", &Probe::find)
      .def("set_rest", [](Probe& p, int c, const Array& rest) { p.chains[c].set_rest(list_of(rest)); })
      .def("forget", [](Probe& p) { p.search.clear(); });
}

}  // namespace bt
