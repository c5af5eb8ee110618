// How much the core has asked the heap for, so that "nothing is allocated in a step" can be measured.
#pragma once
#include <cstddef>

namespace bt {

// Bytes asked for by operator new in this module since it was loaded, freed or not.
size_t allocated_bytes();

}  // namespace bt
