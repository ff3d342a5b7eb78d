#pragma once

/// @file
/// What the lanes of a warp do together.

#include <cstdint>

namespace segsim::renderer::cuda {

inline constexpr unsigned kAllLanes = 0xFFFFFFFFU;
inline constexpr int kWarp = 32;

__device__ inline int lane_index() { return static_cast<int>(threadIdx.x) % kWarp; }

/// Sums of the values of lanes 0 ... this one.
__device__ inline int inclusive_sum(int value) {
  const int lane = lane_index();
#pragma unroll
  for (int step = 1; step < kWarp; step *= 2) {
    const int other = __shfl_up_sync(kAllLanes, value, step);
    if (lane >= step) value += other;
  }
  return value;
}

/// The first lane whose inclusive sum exceeds `at`; at < the last lane's sum.
__device__ inline int lane_of(int inclusive, int at) {
  int lane = 0;
#pragma unroll
  for (int step = kWarp / 2; step > 0; step /= 2) {
    if (__shfl_sync(kAllLanes, inclusive, lane + step - 1) <= at) lane += step;
  }
  return lane;
}

}  // namespace segsim::renderer::cuda
