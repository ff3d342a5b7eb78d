/// @file
/// What happens around the projection: cameras, culling depths, and the order of the tiles.

#include <cmath>

#include "renderer/cuda/kernels.h"
#include "renderer/cuda/warp.cuh"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::cuda {
namespace {

constexpr int kBoundLanes = 8;

/// Depth beyond which a tile's surfels are probably hidden: where the last frame's tiles that
/// show the same place were finished, and a little more. Any value is right.
/// @param part  Of the places looked at, 0 ... kBoundLanes - 1: the bound is the largest.
__device__ float bound_of_tile(const FrameView& frame, int camera_index, int tile_x,
                               int tile_y, int part) {
  const ProjectionCamera<float>& now = frame.camera[camera_index].pinhole;
  const ProjectionCamera<float>& before = frame.previous_camera[camera_index].pinhole;
  const float* ended_m =
      frame.ended_m + static_cast<std::size_t>(camera_index) * frame.tiles_x * frame.tiles_y;
  const Vec3<float> moved{now.centre_m.x - before.centre_m.x,
                          now.centre_m.y - before.centre_m.y,
                          now.centre_m.z - before.centre_m.z};
  const float x = ((static_cast<float>(tile_x) + 0.5F) * kTilePx - now.cx_px) / now.fx_px;
  const float y = ((static_cast<float>(tile_y) + 0.5F) * kTilePx - now.cy_px) / now.fy_px;
  const Vec3<float> ray{now.right.x * x + now.down.x * y + now.forward.x,
                        now.right.y * x + now.down.y * y + now.forward.y,
                        now.right.z * x + now.down.z * y + now.forward.z};
  // Where the place was depends on its depth, which is not known: anywhere between the image
  // of a far point and that of one as near as what was seen about there. What was hidden then
  // and is seen now lies beside, as far away as these two are apart.
  const auto image_of = [&](const Vec3<float>& place, float2& at) {
    const float z = dot(before.forward, place);
    at.x = (before.fx_px * dot(before.right, place) / z + before.cx_px) / kTilePx;
    at.y = (before.fy_px * dot(before.down, place) / z + before.cy_px) / kTilePx;
    return z > 0.0F;
  };
  const auto inside = [&](int tx, int ty) {
    return ended_m[min(max(ty, 0), frame.tiles_y - 1) * frame.tiles_x +
                   min(max(tx, 0), frame.tiles_x - 1)];
  };
  float2 far{}, near{};
  if (!image_of(ray, far)) return INFINITY;
  if (!(far.x > -1.0F && far.y > -1.0F && far.x < static_cast<float>(frame.tiles_x + 1) &&
        far.y < static_cast<float>(frame.tiles_y + 1))) {
    return INFINITY;
  }
  float nearest_m = INFINITY;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      nearest_m = fminf(nearest_m, inside(static_cast<int>(floorf(far.x)) + dx,
                                          static_cast<int>(floorf(far.y)) + dy));
    }
  }
  if (!(nearest_m < INFINITY)) return INFINITY;
  if (!image_of({moved.x + ray.x * nearest_m, moved.y + ray.y * nearest_m,
                 moved.z + ray.z * nearest_m},
                near)) {
    return INFINITY;
  }
  const float apart = fmaxf(fabsf(near.x - far.x), fabsf(near.y - far.y));
  constexpr float kMostTiles = 8.0F;
  if (!(apart < kMostTiles)) return INFINITY;
  const float reach = 0.75F + apart;
  const int x_lo = static_cast<int>(floorf(fminf(near.x, far.x) - reach));
  const int x_hi = static_cast<int>(floorf(fmaxf(near.x, far.x) + reach));
  const int y_lo = static_cast<int>(floorf(fminf(near.y, far.y) - reach));
  const int y_hi = static_cast<int>(floorf(fmaxf(near.y, far.y) + reach));
  float deepest_m = 0.0F;
  const int width = x_hi - x_lo + 1, count = width * (y_hi - y_lo + 1);
  for (int i = part; i < count; i += kBoundLanes) {
    deepest_m = fmaxf(deepest_m, inside(x_lo + i % width, y_lo + i / width));
  }
  return 1.03F * deepest_m + sqrtf(dot(moved, moved));
}

__global__ void begin_frame(FrameView frame) {
  const int tiles = frame.tiles_x * frame.tiles_y;
  const int thread = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  const int tile = thread / kBoundLanes, part = thread % kBoundLanes;
  if (thread < kQueueWords) frame.queue[thread] = 0;
  if (thread == 0) *frame.status = FrameStatus{};
  float bound_m = INFINITY;
  if (tile < tiles * frame.cameras && frame.culls && frame.history[tile / tiles]) {
    const int at = tile % tiles;
    bound_m = bound_of_tile(frame, tile / tiles, at % frame.tiles_x, at / frame.tiles_x, part);
  }
#pragma unroll
  for (int step = 1; step < kBoundLanes; step *= 2) {
    bound_m = fmaxf(bound_m, __shfl_xor_sync(kAllLanes, bound_m, step));
  }
  if (tile >= tiles * frame.cameras || part != 0) return;
  frame.count[tile] = 0;
  frame.redo[tile] = 0;
  frame.bound_m[tile] = bound_m;
}

constexpr int kOrderThreads = 1024;
constexpr int kOrderBins = 256;

/// Tiles by list length, the longest first, to eight steps an octave: one block.
__global__ void __launch_bounds__(kOrderThreads) order_tiles(FrameView frame) {
  __shared__ std::uint32_t bins[kOrderBins];
  __shared__ unsigned long long pairs;
  __shared__ std::uint32_t longest;
  const int thread = static_cast<int>(threadIdx.x);
  const int tiles = frame.tiles_x * frame.tiles_y * frame.cameras;
  if (thread < kOrderBins) bins[thread] = 0;
  if (thread == 0) pairs = 0, longest = 0;
  __syncthreads();
  const auto bin_of = [](std::uint32_t count) {
    // Exponent and three bits of the fraction, from the largest down.
    return kOrderBins - 1 -
           static_cast<int>((__float_as_uint(static_cast<float>(count) + 1.0F) >> 20) -
                            0x3F8U);
  };
  unsigned long long my_pairs = 0;
  std::uint32_t my_longest = 0;
  for (int tile = thread; tile < tiles; tile += kOrderThreads) {
    const std::uint32_t count = frame.count[tile];
    my_pairs += count;
    my_longest = max(my_longest, count);
    atomicAdd(&bins[bin_of(count)], 1U);
  }
  my_longest = __reduce_max_sync(kAllLanes, my_longest);
  for (int step = kWarp / 2; step > 0; step /= 2) {
    my_pairs += __shfl_down_sync(kAllLanes, my_pairs, step);
  }
  if (lane_index() == 0) {
    atomicMax(&longest, my_longest);
    atomicAdd(&pairs, my_pairs);
  }
  __syncthreads();
  if (thread < kWarp) {
    constexpr int kEach = kOrderBins / kWarp;
    int sum = 0;
    for (int i = 0; i < kEach; ++i) sum += static_cast<int>(bins[thread * kEach + i]);
    int start = inclusive_sum(sum) - sum;
    for (int i = 0; i < kEach; ++i) {
      const int here = static_cast<int>(bins[thread * kEach + i]);
      bins[thread * kEach + i] = static_cast<std::uint32_t>(start);
      start += here;
    }
  }
  __syncthreads();
  for (int tile = thread; tile < tiles; tile += kOrderThreads) {
    const std::uint32_t at = atomicAdd(&bins[bin_of(frame.count[tile])], 1U);
    frame.order[at] = static_cast<std::uint32_t>(tile);
  }
  for (int camera = thread; camera < frame.cameras; camera += kOrderThreads) {
    frame.history[camera] = true;
  }
  if (thread == 0) {
    frame.queue[3] = frame.queue[4] = 0;  // bin_large() has done with them.
    frame.status->pairs_binned = pairs;
    frame.status->longest_list = longest;
  }
}

struct CameraBlock {
  ViewCamera camera[kCamerasALaunch];
};

__global__ void store_cameras(CameraBlock block, int first, int count, ViewCamera* camera,
                              ViewCamera* previous) {
  const int i = static_cast<int>(threadIdx.x);
  if (i >= count) return;
  previous[first + i] = camera[first + i];
  camera[first + i] = block.camera[i];
}

}  // namespace

ViewCamera view_camera(const ProjectionCamera<float>& c, int width_px, int height_px) {
  ViewCamera view{c, {}, {}};
  view.slope[0] = (-kFrustumMarginPx - c.cx_px) / c.fx_px;
  view.slope[1] = (static_cast<float>(width_px) + kFrustumMarginPx - c.cx_px) / c.fx_px;
  view.slope[2] = (-kFrustumMarginPx - c.cy_px) / c.fy_px;
  view.slope[3] = (static_cast<float>(height_px) + kFrustumMarginPx - c.cy_px) / c.fy_px;
  for (int side = 0; side < 4; ++side) {
    view.norm[side] = std::sqrt(1.0F + view.slope[side] * view.slope[side]);
  }
  return view;
}

void launch_store_cameras(const ProjectionCamera<float>* cameras, int count,
                          const FrameView& frame, cudaStream_t stream) {
  // By value, so that the caller's memory is free again at once.
  CameraBlock block;
  for (int first = 0; first < count; first += kCamerasALaunch) {
    const int here = count - first < kCamerasALaunch ? count - first : kCamerasALaunch;
    for (int i = 0; i < here; ++i)
      block.camera[i] = view_camera(cameras[first + i], frame.width_px, frame.height_px);
    store_cameras<<<1, kCamerasALaunch, 0, stream>>>(
        block, first, here, const_cast<ViewCamera*>(frame.camera),
        const_cast<ViewCamera*>(frame.previous_camera));
    throw_on_error(cudaGetLastError(), "store_cameras");
  }
}

void launch_begin_frame(const FrameView& frame, cudaStream_t stream) {
  constexpr int kThreads = 128;
  const int threads = frame.tiles_x * frame.tiles_y * frame.cameras * kBoundLanes;
  begin_frame<<<(threads + kThreads - 1) / kThreads, kThreads, 0, stream>>>(frame);
  throw_on_error(cudaGetLastError(), "begin_frame");
}

void launch_order_tiles(const FrameView& frame, cudaStream_t stream) {
  order_tiles<<<1, kOrderThreads, 0, stream>>>(frame);
  throw_on_error(cudaGetLastError(), "order_tiles");
}

}  // namespace segsim::renderer::cuda
