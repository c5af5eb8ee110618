// The Python interface of the core (module bullet_tendon._core): arrays in, arrays out, no logic.
// Python validates before it calls; nothing here is public.
#include <pybind11/stl.h>

#include <atomic>
#include <cstdlib>
#include <new>

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
  world.def(py::init<>());
  bind_tendons(m, world);
  bind_bodies(m, world);
  bind_collision(m, world);
  bind_elements(m, world);
  bind_steps(m, world);
  py::module_ testing = m.def_submodule("testing", "What only tests call.");
  bind_testing(testing);
}
