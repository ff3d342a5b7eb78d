#pragma once

#include <ctime>

namespace segsim::tests {

/// CPU time of the calling thread [s], so that a busy machine disturbs a figure less. Time of
/// other threads that work for it is not in it.
inline double thread_cpu_s() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace segsim::tests
