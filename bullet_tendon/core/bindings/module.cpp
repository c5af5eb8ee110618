// The Python interface of the core (module bullet_tendon._core): arrays in, arrays out, no logic.
// Python validates before it calls; nothing here is public.
#include <pybind11/stl.h>

#include <atomic>
#include <cstdlib>
#include <new>
#include <utility>

#include "bindings/arrays.h"

namespace {

// The replaceable allocation functions of this module: malloc and free, with a count.

std::atomic<size_t> asked{0};

void* counted(size_t bytes) {
  asked.fetch_add(bytes, std::memory_order_relaxed);
  return std::malloc(bytes > 0 ? bytes : 1);
}

}  // namespace

void* operator new(size_t bytes) {
  if (void* p = counted(bytes)) return p;
  throw std::bad_alloc();
}
void* operator new(size_t bytes, const std::nothrow_t&) noexcept { return counted(bytes); }
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, size_t) noexcept { std::free(p); }

namespace bt {

// Bytes asked for by operator new in this module since it was loaded, freed or not.
size_t allocated_bytes() { return asked.load(std::memory_order_relaxed); }

}  // namespace bt

using namespace bt;

PYBIND11_MODULE(_core, m) {
  m.doc() = "Compiled core of bullet_tendon: mechanics, contact and time stepping.";
  m.def("allocated_bytes", &allocated_bytes);
  m.attr("CUT_OFF_RATE") = kCutOff * kMostRate;
  m.attr("MOST_RATE") = kMostRate;
  GuardedWorld world(m);
  bind_report(m);
  bind_material(m);
  bind_articulated(m);
  bind_links(m, world);
  bind_bodies(m, world);
  bind_shapes(m);
  bind_distance_grid(m);
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
  world.def(py::init<>());
  bind_world_tendon(world);
  bind_world_bodies(world);
  bind_world_collision(world);
  bind_world_elements(world);
  bind_world_world(world);
}
