// Vector units: what loops are compiled for.
#pragma once

namespace bt {

constexpr int kLanes = 8;
typedef double Eight __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));

}  // namespace bt

// Loops over particles and springs are compiled for several vector units, and the machine's own is
// taken when the module is loaded. Fused multiply-adds stay off (setup.py): all give the same bits.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__)
#define BT_VECTOR __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define BT_VECTOR
#endif

// Functions to be compiled with those that call them, for their vector units.
#define BT_WITHIN __attribute__((always_inline))
