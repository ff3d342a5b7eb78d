#pragma once

/// @file
/// Spherical harmonics of a warp's surfels in shared memory: rows are read and written by the
/// whole warp, since a lane alone would touch a memory line for every coefficient.

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "renderer/cuda/warp.cuh"

namespace segsim::reconstruction::cuda {

/// @tparam kDegree  Of the stored coefficients.
template <int kDegree>
struct StagedSh {
  static constexpr int kRow = 3 * (kDegree + 1) * (kDegree + 1);  ///< Floats of a surfel.
  /// Odd, so that the lanes' rows start in different banks.
  static constexpr int kStride = kRow | 1;
  float value[renderer::cuda::kWarp * kStride];

  __device__ float* row() { return value + renderer::cuda::lane_index() * kStride; }

  /// Reads the rows of `lanes`, whose surfels are `id`.
  __device__ void load(const float* sh, unsigned lanes, std::uint32_t id) {
    for_each_row(lanes, id, [&](std::size_t first, float* row, int k) {
      const auto to = static_cast<unsigned>(__cvta_generic_to_shared(row + k));
      asm volatile("cp.async.ca.shared.global [%0], [%1], 4;" ::"r"(to), "l"(sh + first + k)
                   : "memory");
    });
    asm volatile("cp.async.wait_all;" ::: "memory");
    __syncwarp();
  }
  /// Writes them.
  __device__ void store(float* sh, unsigned lanes, std::uint32_t id) {
    __syncwarp();
    for_each_row(lanes, id,
                 [&](std::size_t first, const float* row, int k) { sh[first + k] = row[k]; });
  }

 private:
  template <class Body>
  __device__ void for_each_row(unsigned lanes, std::uint32_t id, const Body& body) {
    while (lanes != 0) {
      const int lane = __ffs(static_cast<int>(lanes)) - 1;
      lanes &= lanes - 1;
      const std::size_t first =
          std::size_t{kRow} * __shfl_sync(renderer::cuda::kAllLanes, id, lane);
#pragma unroll
      for (int k = 0; k < kRow; k += renderer::cuda::kWarp) {
        if (k + renderer::cuda::lane_index() < kRow)
          body(first, value + lane * kStride, k + renderer::cuda::lane_index());
      }
    }
  }
};

/// Calls launch(std::integral_constant<int, degree>()), 0 <= degree <= kMost.
template <int kMost, class Launch>
void with_degree(int degree, const Launch& launch) {
  if constexpr (kMost > 0) {
    if (degree < kMost) return with_degree<kMost - 1>(degree, launch);
  }
  launch(std::integral_constant<int, kMost>());
}

/// The same on the device.
template <int kMost, class Body>
__device__ void with_known_degree(int degree, const Body& body) {
  if constexpr (kMost > 0) {
    if (degree < kMost) return with_known_degree<kMost - 1>(degree, body);
  }
  body(std::integral_constant<int, kMost>());
}

}  // namespace segsim::reconstruction::cuda
