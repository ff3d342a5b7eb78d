#pragma once

/// @file
/// Loops that are compiled twice: for every x86-64 processor, and for eight lanes.

/// Before a function whose loop vectorises: the program takes the AVX2 clone where the
/// processor has that. Both give the same bits, as AVX2 alone fuses no multiplication with an
/// addition. Not under sanitizers, whose runtimes are not there yet when clones are chosen.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__) && !defined(__clang__)
#define SEGSIM_VECTOR_CLONES [[gnu::target_clones("avx2", "default")]]
#else
#define SEGSIM_VECTOR_CLONES
#endif
