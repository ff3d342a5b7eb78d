#pragma once

/// @file
/// Surfels with many tiles, which would hold up the warp that projects them: put aside in
/// parts that many warps share.

#include "renderer/cuda/kernels.h"
#include "renderer/cuda/tile_spans.cuh"
#include "renderer/cuda/warp.cuh"

namespace segsim::renderer::cuda {

inline constexpr int kProjectThreads = 128;

/// Of a surfel with many tiles: some of its rows, for one warp of bin_large().
struct LargePart {
  Candidate candidate;
  std::uint32_t id;
  int camera;
};
static_assert(sizeof(LargePart) == kLargePartBytes);

/// A surfel whose box has more tiles than this would hold up its warp.
inline constexpr int kLargeTiles = 48;
inline constexpr int kRowsAPart = 8, kColumnsAPart = 32;

__device__ inline bool is_large(const Candidate& c) {
  return (c.x_end - c.x_begin) * (c.y_end - c.y_begin) > kLargeTiles;
}

/// Puts a surfel aside for bin_large(). @return  False if there is no room.
__device__ inline bool put_aside(const FrameView& frame, int camera, const Candidate& c,
                                 std::uint32_t id) {
  const int rows = (c.y_end - c.y_begin + kRowsAPart - 1) / kRowsAPart;
  const int columns = (c.x_end - c.x_begin + kColumnsAPart - 1) / kColumnsAPart;
  const auto parts = static_cast<std::uint32_t>(rows * columns);
  const std::uint32_t at = atomicAdd(&frame.queue[3], parts);
  if (at + parts > frame.large_capacity) return false;
  atomicMax(&frame.queue[4], at + parts);
  auto* part = reinterpret_cast<LargePart*>(frame.large) + at;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      LargePart p{c, id, camera};
      p.candidate.x_begin = c.x_begin + x * kColumnsAPart;
      p.candidate.x_end = min(c.x_end, p.candidate.x_begin + kColumnsAPart);
      p.candidate.y_begin = c.y_begin + y * kRowsAPart;
      p.candidate.y_end = min(c.y_end, p.candidate.y_begin + kRowsAPart);
      *part++ = p;
    }
  }
  return true;
}

/// A warp takes four parts at a time, from four places of the list: neighbours there are of
/// one surfel, or of surfels as large.
template <bool kRedo>
static __global__ void __launch_bounds__(kProjectThreads) bin_large(FrameView frame) {
  constexpr int kParts = kWarp / kRowsAPart;
  // Without the parts that put_aside() refused: they came last.
  const int count = static_cast<int>(frame.queue[4]);
  const int groups = (count + kParts - 1) / kParts;
  const int warps = static_cast<int>(gridDim.x * blockDim.x) / kWarp;
  for (int group = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x) / kWarp;
       group < groups; group += warps) {
    const int at = group + lane_index() / kRowsAPart * groups;
    Span span{0, 0, {0, 0}};
    int row = 0;
    float z0_m = 0.0F;
    std::uint32_t id = 0;
    int first_tile = 0;
    if (at < count) {
      const LargePart& part = reinterpret_cast<const LargePart*>(frame.large)[at];
      row = part.candidate.y_begin + lane_index() % kRowsAPart;
      z0_m = part.candidate.z0_m;
      id = part.id;
      first_tile = first_tile_of(frame, part.camera);
      if (row < part.candidate.y_end) span = tiles_in_row(part.candidate, row);
    }
    emit_spans<kRedo>(frame, first_tile, span, row, z0_m, id);
  }
}

template <bool kRedo>
void launch_bin_large(const FrameView& frame, cudaStream_t stream) {
  constexpr unsigned kLargeBlocks = 132 * 16;
  bin_large<kRedo><<<kLargeBlocks, kProjectThreads, 0, stream>>>(frame);
  throw_on_error(cudaGetLastError(), "bin_large");
}

}  // namespace segsim::renderer::cuda
