#pragma once

/// @file
/// Parts of a tile: 8 x 4 pixels, one a lane; parts 2 q and 2 q + 1 are the upper and lower
/// half of quarter q. Surfels come in groups of 32, copied to shared memory while those before
/// are at work.

#include "reconstruction/rasterizer/cuda/training_data.h"
#include "renderer/cuda/tile_list.cuh"
#include "renderer/cuda/warp.cuh"

namespace segsim::reconstruction::cuda {

inline constexpr int kQuarters = 4;
inline constexpr int kPartWidthPx = renderer::cuda::kTilePx / 2,
                     kPartHeightPx = renderer::cuda::kTilePx / 4;
static_assert(kPartWidthPx * kPartHeightPx == kPartPixels &&
              kPartPixels == renderer::cuda::kWarp);
static_assert(kParts * kPartPixels == renderer::cuda::kTilePixels && kParts == 2 * kQuarters);

struct PixelPlace {
  int x, y;
};

__device__ inline PixelPlace first_pixel_of(const renderer::cuda::FrameView& frame, int tile,
                                            int part) {
  return {tile % frame.tiles_x * renderer::cuda::kTilePx + part / 2 % 2 * kPartWidthPx,
          tile / frame.tiles_x * renderer::cuda::kTilePx +
              (part / 4 * 2 + part % 2) * kPartHeightPx};
}

__device__ inline PixelPlace pixel_of(const PixelPlace& first, int lane) {
  return {first.x + lane % kPartWidthPx, first.y + lane / kPartWidthPx};
}

__device__ inline bool in_image(const renderer::cuda::FrameView& frame, const PixelPlace& p) {
  return p.x < frame.width_px && p.y < frame.height_px;
}

/// Groups of surfels of all warps of a block, word by word, twice: one is used while the other
/// arrives.
template <int kThreads>
struct StagedSurfels {
  float4 word[2][kRecordWords][kThreads];

  /// Starts copying a surfel to this thread's place.
  __device__ void copy(int buffer, const DrawnRecord& record) {
    const auto* from = reinterpret_cast<const float4*>(&record);
#pragma unroll
    for (int w = 0; w < kRecordWords; ++w) {
      const auto to =
          static_cast<unsigned>(__cvta_generic_to_shared(&word[buffer][w][threadIdx.x]));
      asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(to), "l"(from + w)
                   : "memory");
    }
  }
  /// Waits for this thread's copies.
  static __device__ void wait() { asm volatile("cp.async.wait_all;" ::: "memory"); }

  /// The surfel that thread `place` copied.
  __device__ DrawnSurfel<float> read(int buffer, int place) const {
    DrawnRecord record;
    auto* to = reinterpret_cast<float4*>(&record);
#pragma unroll
    for (int w = 0; w < kRecordWords; ++w) to[w] = word[buffer][w][place];
    return record.surfel;
  }
};

/// A pixel's place in a tile's sums; planes are kTilePixels apart.
__device__ inline std::size_t state_place(std::uint32_t tile, int part, int lane) {
  return std::size_t{tile} * (kStatePlanes * renderer::cuda::kTilePixels) +
         static_cast<std::size_t>(part * kPartPixels + lane);
}

__device__ inline void save_sums(float* state, const PixelSums<float>& s) {
  const float values[kStatePlanes] = {
      s.transmittance,      s.rgb.x,    s.rgb.y,    s.rgb.z, s.depth_m,
      s.normal.x,           s.normal.y, s.normal.z, s.m1,    s.m2,
      s.first_inverse_depth};
#pragma unroll
  for (int plane = 0; plane < kStatePlanes; ++plane) {
    state[plane * renderer::cuda::kTilePixels] = values[plane];
  }
}

__device__ inline PixelSums<float> load_sums(const float* state) {
  const auto plane = [state](int i) { return state[i * renderer::cuda::kTilePixels]; };
  PixelSums<float> s;
  s.transmittance = plane(0);
  s.rgb = {plane(1), plane(2), plane(3)};
  s.depth_m = plane(4);
  s.normal = {plane(5), plane(6), plane(7)};
  s.m1 = plane(8), s.m2 = plane(9);
  s.first_inverse_depth = plane(10);
  return s;
}

/// Of a part's first entry in TrainingView::hits.
__device__ inline std::size_t hits_place(const TrainingView& view, std::uint32_t tile,
                                         int part) {
  return std::size_t{kParts} * view.list_base[tile] +
         static_cast<std::size_t>(part) * view.frame.count[tile];
}

/// Of a quarter's first entry in TrainingView::part.
__device__ inline std::size_t parts_place(const TrainingView& view, std::uint32_t tile,
                                          int quarter) {
  return std::size_t{kQuarters} * view.list_base[tile] +
         static_cast<std::size_t>(quarter) * view.frame.count[tile];
}

}  // namespace segsim::reconstruction::cuda
