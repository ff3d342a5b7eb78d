#pragma once

/// @file
/// Tiles: their lists sorted, blended front to back, and resolved into images, all in one
/// kernel whose blocks take tile after tile, the longest lists first. raster.cu and
/// raster_many.cu compile it for different K.
///
/// A block of four warps draws 16 x 16 pixels; a warp draws 8 x 8 of them, two a lane, so that
/// what it reads of a surfel serves 64 pixels. Each warp skips the surfels whose outline does
/// not reach its quarter.

#include "renderer/cuda/kernels.h"
#include "renderer/cuda/pixel.cuh"
#include "renderer/cuda/resolve.cuh"
#include "renderer/cuda/resolve_many.cuh"

namespace segsim::renderer::cuda {

__device__ inline std::uint8_t to_byte(float value) {
  return static_cast<std::uint8_t>(__saturatef(value) * 255.0F + 0.5F);
}

template <bool kRgb, bool kNormal, int kKeys>
__device__ void write_pixel(const RasterJob& job, TileShared& shared,
                            const Pixel<kKeys>& pixel, int pixel_of_block,
                            const std::uint32_t* earlier, std::size_t at) {
  const FrameView& frame = job.frame;
  const ImageView& image = frame.image;
  const float alpha = 1.0F - pixel.transmittance;
  const bool surface = alpha >= kMinSurfaceAlpha;
  image.alpha[at] = alpha;
  if (kRgb && image.rgb != nullptr) {
    image.rgb[3 * at] = to_byte(pixel.r);
    image.rgb[3 * at + 1] = to_byte(pixel.g);
    image.rgb[3 * at + 2] = to_byte(pixel.b);
  }
  if (image.depth_m != nullptr) {
    const float depth_m = frame.median_depth ? pixel.depth : pixel.depth / alpha;
    image.depth_m[at] = surface ? depth_m : NAN;
  }
  if (kNormal && image.normal != nullptr) {
    const float length2 = pixel.nx * pixel.nx + pixel.ny * pixel.ny + pixel.nz * pixel.nz;
    const float scale = surface && length2 > 0.0F ? rsqrtf(length2) : 0.0F;
    image.normal[3 * at] = pixel.nx * scale;
    image.normal[3 * at + 1] = pixel.ny * scale;
    image.normal[3 * at + 2] = pixel.nz * scale;
  }
  if (!frame.labels && !frame.features) return;
  Label label;
  if constexpr (kKeys > 0) {
    typename Keys<kKeys>::Selected selected;
    if (surface) pixel.keys.select(shared, pixel_of_block, earlier, frame, selected);
    if (frame.counts) atomicAdd(&shared.fetches, static_cast<unsigned>(selected.count));
    if (frame.labels && job.field.head != nullptr) {
      label = resolve_panoptic(selected, job.field);
    } else if (frame.labels && job.label != nullptr) {
      label = vote_labels(selected, job.label);
    }
    if (frame.features) {
      if (job.features.semantic != nullptr) {
        mean_of<16>(selected, job.features.semantic, image.semantic_feature + 16 * at);
        mean_of<32>(selected, job.features.instance, image.instance_feature + 32 * at);
      }
    }
  }
  if (frame.features && job.features.semantic == nullptr) {
    for (int c = 0; c < 16; ++c) image.semantic_feature[16 * at + c] = 0.0F;
    for (int c = 0; c < 32; ++c) image.instance_feature[32 * at + c] = 0.0F;
  }
  if (!frame.labels) return;
  image.semantic[at] = label.semantic;
  image.instance[at] = label.instance;
  image.confidence[at] = label.confidence;
  image.instance_confidence[at] = label.instance_confidence;
}

/// What a warp needs to go through a chunk of its tile's list.
struct ListWalk {
  const SurfelRecord* records;  ///< Of the camera.
  const std::uint32_t* place;
  int chunk;  ///< Entries.

  /// A lane's entry of a group of 32.
  struct Entry {
    bool reaches;
    std::uint32_t place;
  };
  __device__ Entry entry_of(const ListShared& list, int group) const {
    const int entry = group * kWarp + lane_index();
    const int warp = static_cast<int>(threadIdx.x) / kWarp;
    const bool reaches = entry < chunk && (list.quarters(entry) >> warp & 1U) != 0;
    return {reaches, reaches ? place[list.id(entry)] : 0U};
  }
};

/// Blends a chunk into the warp's quarter: 32 entries at a time, the next ones under way.
/// Warps do not wait for one another.
/// @return  False if all pixels are finished.
template <bool kRgb, bool kNormal, int kKeys>
__device__ bool blend_chunk(const RasterJob& job, TileShared& shared, const ListWalk& walk,
                            int done, Quarter<kRgb, kNormal, kKeys>& quarter,
                            std::uint32_t& evaluations) {
  const int lane = lane_index(), warp_first = static_cast<int>(threadIdx.x) - lane;
  const int groups = (walk.chunk + kWarp - 1) / kWarp;
  ListWalk::Entry here = walk.entry_of(shared.list, 0);
  if (here.reaches) stage(shared, 0, walk.records[here.place]);
  ListWalk::Entry next = walk.entry_of(shared.list, 1);
  bool live = true;
  int group = 0;
  for (; group < groups && live; ++group) {
    const int buffer = group & 1;
    // This group has arrived, and all lanes have done with the buffer that is filled next.
    wait_for_copies();
    __syncwarp();
    unsigned todo = __ballot_sync(kAllLanes, here.reaches);
    if (next.reaches) stage(shared, buffer ^ 1, walk.records[next.place]);
    here = next;
    next = walk.entry_of(shared.list, group + 2);
    evaluations += static_cast<std::uint32_t>(__popc(todo)) * (2 * kWarp);
    while (todo != 0) {
      const int i = __ffs(static_cast<int>(todo)) - 1;
      todo &= todo - 1;
      quarter.blend(job, shared, buffer, warp_first + i, group * kWarp + i);
    }
    if (kKeys > 0 && job.frame.labels_only) quarter.end_closed(job.frame);
    live = __any_sync(kAllLanes, quarter.live());
  }
  wait_for_copies();  // Of a group that no one needed.
  const int read = min(group * kWarp, walk.chunk);
  if (lane == 0) {
    atomicMax(&shared.touched, done + read);
    if (!live) atomicMax(&shared.ended_bits, shared.list.depth_bits(read - 1));
  }
  return live;
}

/// Draws one tile. The block enters and leaves it together.
template <bool kRgb, bool kNormal, int kKeys>
__device__ void draw_tile(const RasterJob& job, TileShared& shared, int tile) {
  const FrameView& frame = job.frame;
  const int thread = static_cast<int>(threadIdx.x);
  const int warp = thread / kWarp, lane = lane_index();
  const int camera_tiles = frame.tiles_x * frame.tiles_y;
  const int camera = tile / camera_tiles;
  const int tile_x = tile % camera_tiles % frame.tiles_x;
  const int tile_y = tile % camera_tiles / frame.tiles_x;
  const int in_x = warp % 2 * kQuarterPx + lane % kQuarterPx;
  const int in_y = warp / 2 * kQuarterPx + lane / kQuarterPx;
  const int x = tile_x * kTilePx + in_x, y = tile_y * kTilePx + in_y;

  Quarter<kRgb, kNormal, kKeys> quarter;
  quarter.x_px = static_cast<float>(x) + 0.5F;
  quarter.y_px = static_cast<float>(y) + 0.5F;
  quarter.pixel[0].clear(x < frame.width_px && y < frame.height_px);
  quarter.pixel[1].clear(x < frame.width_px && y + kPixelStep < frame.height_px);

  const std::uint32_t listed = frame.count[tile];
  const int count = static_cast<int>(min(listed, frame.capacity));
  const ListKey* list = frame.bucket + static_cast<std::size_t>(tile) * frame.capacity;
  if (thread == 0) {
    shared.ended_bits = 0;
    shared.touched = 0;
    shared.evaluations = shared.contributions = shared.fetches = 0;
    if (job.redo && listed > frame.capacity) {
      atomicMax(&frame.status->longest_list, listed);
    }
  }
  std::uint32_t evaluations = 0;
  int done = 0;
  ListKey next = 0;
  bool live = __any_sync(kAllLanes, quarter.live());
  bool tile_live = true;
  while (tile_live) {
    const int chunk = next_chunk<kTileThreads>(shared.list, list, count, done, next);
    if (chunk == 0) break;
    if (live) {
      const ListWalk walk{job.record + static_cast<std::size_t>(camera) * job.padded_surfels,
                          job.place, chunk};
      live = blend_chunk(job, shared, walk, done, quarter, evaluations);
    }
    done += chunk;
    tile_live = __syncthreads_or(live ? 1 : 0) != 0;
    if (tile_live && done < count) {
#pragma unroll
      for (int p = 0; p < 2; ++p) {
        quarter.pixel[p].keys.leave_chunk(shared, pixel_of_thread(p), quarter.earlier[p],
                                          frame);
      }
      __syncthreads();
    }
  }
  const bool finished = __syncthreads_or(live ? 1 : 0) == 0;
  const bool culled = !job.redo && frame.culls && !finished && frame.bound_m[tile] < INFINITY;
  if (thread == 0) {
    frame.ended_m[tile] = finished ? __uint_as_float(shared.ended_bits) : INFINITY;
    if (culled) {
      frame.redo[tile] = 1;
      frame.redo_list[atomicAdd(&frame.queue[2], 1U)] = static_cast<std::uint32_t>(tile);
    }
  }
  if (!culled) {
    const std::size_t row = static_cast<std::size_t>(camera) * frame.height_px + y;
    const std::size_t at = row * frame.width_px + x;
    // Not written out twice: the code would not fit in the instruction cache.
#pragma unroll 1
    for (int p = 0; p < 2; ++p) {
      if (x >= frame.width_px || y + kPixelStep * p >= frame.height_px) break;
      const Pixel<kKeys> pixel = p == 0 ? quarter.pixel[0] : quarter.pixel[1];
      write_pixel<kRgb, kNormal, kKeys>(
          job, shared, pixel, pixel_of_thread(p), quarter.earlier[p],
          at + static_cast<std::size_t>(kPixelStep * p) * frame.width_px);
    }
  }
  if (lane == 0) atomicAdd(&shared.evaluations, evaluations);
  if (frame.counts && lane == 0) atomicAdd(&shared.contributions, quarter.contributions);
  __syncthreads();
  if (thread == 0) {
    FrameStatus& status = *frame.status;
    atomicAdd(&status.pairs_touched, static_cast<unsigned long long>(shared.touched));
    atomicAdd(&status.evaluations, static_cast<unsigned long long>(shared.evaluations));
    if (frame.counts) {
      atomicAdd(&status.contributions, static_cast<unsigned long long>(shared.contributions));
      atomicAdd(&status.feature_fetches, static_cast<unsigned long long>(shared.fetches));
    }
    if (job.redo) atomicAdd(&status.fixed_tiles, 1U);
  }
}

/// Many keys take what the launch asks for, beyond the struct's end.
template <int kKeys>
__device__ TileShared& shared_memory() {
  if constexpr (kKeys == kManyKeys) {
    extern __shared__ uint4 memory[];
    return *reinterpret_cast<TileShared*>(memory);
  } else {
    __shared__ TileShared memory;
    return memory;
  }
}

/// A sixth block would fit if registers were spilled, which costs more than it hides.
template <bool kNormal, int kKeys>
inline constexpr int kResidentBlocks = kKeys == kManyKeys    ? 4
                                       : kNormal&& kKeys > 0 ? 5
                                                             : 6;

template <bool kRgb, bool kNormal, int kKeys>
__global__ void __launch_bounds__(kTileThreads, (kResidentBlocks<kNormal, kKeys>))
    raster_tiles(RasterJob job) {
  TileShared& shared = shared_memory<kKeys>();
  const FrameView& frame = job.frame;
  const auto total =
      job.redo ? frame.queue[2]
               : static_cast<std::uint32_t>(frame.tiles_x * frame.tiles_y * frame.cameras);
  while (true) {
    if (threadIdx.x == 0) {
      const std::uint32_t at = atomicAdd(&frame.queue[job.redo ? 1 : 0], 1U);
      shared.tile =
          at < total ? static_cast<int>((job.redo ? frame.redo_list : frame.order)[at]) : -1;
    }
    __syncthreads();
    const int tile = shared.tile;
    if (tile < 0) return;
    draw_tile<kRgb, kNormal, kKeys>(job, shared, tile);
    __syncthreads();
  }
}

template <bool kRgb, bool kNormal, int kKeys>
void launch(const RasterJob& job, cudaStream_t stream) {
  const auto kernel = raster_tiles<kRgb, kNormal, kKeys>;
  std::size_t bytes = 0;
  if constexpr (kKeys == kManyKeys) {
    bytes = shared_bytes(job.frame.top_k);
    throw_on_error(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                        static_cast<int>(shared_bytes(kManyKeys))),
                   "cudaFuncSetAttribute");
  }
  const int tiles = job.frame.tiles_x * job.frame.tiles_y * job.frame.cameras;
  const int resident =
      resident_blocks(reinterpret_cast<const void*>(kernel), kTileThreads, bytes);
  const int wanted = resident < tiles ? resident : tiles;
  // clang-format off
  kernel<<<wanted, kTileThreads, bytes, stream>>>(job);
  // clang-format on
  throw_on_error(cudaGetLastError(), "raster_tiles");
}

/// Of the channels wanted.
template <int kKeys>
void launch_raster_of(const RasterJob& job, cudaStream_t stream) {
  // Colour without normals is common, normals without colour is not.
  if (job.frame.normals) {
    launch<true, true, kKeys>(job, stream);
  } else if (job.frame.colours) {
    launch<true, false, kKeys>(job, stream);
  } else {
    launch<false, false, kKeys>(job, stream);
  }
}

}  // namespace segsim::renderer::cuda
