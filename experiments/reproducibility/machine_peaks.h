#pragma once

/// @file
/// What this machine can do at best, measured: the roof under which a renderer works.

#include <string>

namespace segsim::experiments::reproducibility {

struct MachinePeaks {
  int threads = 1;
  std::string vector_isa;  ///< Of the loops below: "AVX-512", "AVX2" or "baseline".
  double gflops = 0.0;     ///< 32-bit fused multiply-adds, 2 flops each, all threads together.
  double read_gbps = 0.0;  ///< Reading memory beyond the caches, 10^9 bytes/s, all threads.
};

/// Runs both loops on `threads` threads at once and keeps the best of several rounds, since
/// other programs can only slow a round down. @param threads > 0.  @param round_s  Of each of
/// the rounds; 0.02 s is enough to be steady.  Needs 256 MiB of memory.
[[nodiscard]] MachinePeaks measure_machine_peaks(int threads, double round_s = 0.03);

}  // namespace segsim::experiments::reproducibility
