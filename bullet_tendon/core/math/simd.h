// Vector instructions for which loops are compiled.
#pragma once

namespace bt {

constexpr int kLanes = 8;
typedef double Eight __attribute__((vector_size(8 * kLanes), aligned(8), may_alias));

}  // namespace bt

// Loops over particles and springs are compiled for several vector instruction sets. The loader selects the
// best one that the processor supports. Fused multiply-adds are disabled (setup.py), so that all versions
// give the same bits. Sanitizers are not ready when the loader runs its selection.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define BT_VECTOR __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define BT_VECTOR
#endif

// Inlined functions, compiled for the instruction set of their callers.
#define BT_WITHIN __attribute__((always_inline))
