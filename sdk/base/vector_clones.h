// Functions whose loops the compiler vectorises exist twice on x86-64: for AVX2 and for the
// baseline, chosen when the program starts.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define RSFM_VECTOR_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define RSFM_VECTOR_CLONES
#endif
