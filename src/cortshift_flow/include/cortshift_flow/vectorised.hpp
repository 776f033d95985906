// Inner loops are compiled for several instruction sets and the widest that the processor has is chosen at run time.
// Libraries that use this switch multiply-add contraction off, so that all versions give the same bits.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define CORTSHIFT_VECTORISED __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CORTSHIFT_VECTORISED
#endif
