/// @file
/// Tiles' lists -> images. Persistent blocks take tile after tile, the longest lists first;
/// the warps of a block sort a chunk of the list together, and then each draws its part.

#include "reconstruction/rasterizer/cuda/tile_parts.cuh"

namespace segsim::reconstruction::cuda {
namespace {

constexpr int kThreads = kParts * renderer::cuda::kWarp;

struct ForwardShared {
  renderer::cuda::ListShared list;
  StagedSurfels<kThreads> staged;
  int tile;
  std::uint32_t base, segment_base;
};

struct ForwardJob {
  TrainingView view;
  TrainingImages<float> images;
  float* max_weight;
};

/// A warp's part of a tile, and this lane's pixel.
struct PartWalk {
  int part;
  PixelPlace first;
  float x_px, y_px;
  HitMask* hits;          ///< Of the part's first entry.
  float* segment_state;   ///< Of this pixel, before the tile's first segment.
  PixelSums<float> sums;  ///< Of this pixel.
  bool open;              ///< It is not finished.
  std::uint32_t read;     ///< Entries looked at.

  /// Can the surfel reach the part?
  __device__ bool meets(const SurfelPixels& p) const {
    return p.x_lo < first.x + kPartWidthPx && p.x_hi >= first.x &&
           p.y_lo < first.y + kPartHeightPx && p.y_hi >= first.y;
  }
  /// @return  The surfel's weight; 0 if it does not count here.
  __device__ float blend(const DrawnSurfel<float>& s) {
    SurfelHit<float> hit;
    if (!open || !meet_surfel(s, x_px, y_px, hit)) return 0.0F;
    const float weight = blend_hit(s, hit, sums);
    open = weight >= 0.0F;
    return open ? weight : 0.0F;
  }
};

struct ListEntry {
  bool reaches;
  std::uint32_t id;
};

/// A lane's entry of a group of 32; groups begin at multiples of 32 of the whole list.
/// @param done  Entries of chunks before.
__device__ ListEntry entry_of(const TrainingView& view, const renderer::cuda::ListShared& list,
                              const PartWalk& walk, int chunk, int done, int group) {
  const int entry = group * renderer::cuda::kWarp + renderer::cuda::lane_index() - done;
  if (entry < 0 || entry >= chunk) return {false, 0};
  if ((list.quarters(entry) >> (walk.part / 2) & 1U) == 0) return {false, 0};
  const std::uint32_t id = list.id(entry);
  return {walk.meets(view.pixels[id]), id};
}

/// Blends a chunk into the warp's part.
__device__ void blend_chunk(const ForwardJob& job, ForwardShared& shared, int chunk, int done,
                            PartWalk& walk) {
  const TrainingView& view = job.view;
  const int lane = renderer::cuda::lane_index(),
            warp_first = static_cast<int>(threadIdx.x) - lane;
  int group = done / renderer::cuda::kWarp;
  const int end = (done + chunk + renderer::cuda::kWarp - 1) / renderer::cuda::kWarp;
  ListEntry here = entry_of(view, shared.list, walk, chunk, done, group);
  if (here.reaches) shared.staged.copy(group & 1, view.drawn[here.id]);
  ListEntry next = entry_of(view, shared.list, walk, chunk, done, group + 1);
  bool live = true;
  for (; group < end && live; ++group) {
    const int buffer = group & 1;
    // This group has arrived, and all lanes have done with the buffer that is filled next.
    shared.staged.wait();
    __syncwarp();
    unsigned todo = __ballot_sync(renderer::cuda::kAllLanes, here.reaches);
    if (next.reaches) shared.staged.copy(buffer ^ 1, view.drawn[next.id]);
    const std::uint32_t my_id = here.id;
    here = next;
    next = entry_of(view, shared.list, walk, chunk, done, group + 2);
    constexpr int kSegmentGroups = kSegment / renderer::cuda::kWarp;
    if (group % kSegmentGroups == 0 && group * renderer::cuda::kWarp >= done) {
      const std::size_t segment = static_cast<std::size_t>(group / kSegmentGroups);
      save_sums(walk.segment_state + segment * (kStatePlanes * renderer::cuda::kTilePixels),
                walk.sums);
    }
    HitMask my_hits = 0;
    while (todo != 0) {
      const int i = __ffs(static_cast<int>(todo)) - 1;
      todo &= todo - 1;
      const float weight = walk.blend(shared.staged.read(buffer, warp_first + i));
      const HitMask hits = __ballot_sync(renderer::cuda::kAllLanes, weight > 0.0F);
      if (lane == i) my_hits = hits;
      if (job.max_weight != nullptr && hits != 0) {
        // Weights are not negative: their bits are in the same order.
        const unsigned most =
            __reduce_max_sync(renderer::cuda::kAllLanes, __float_as_uint(weight));
        if (lane == i) atomicMax(reinterpret_cast<unsigned*>(job.max_weight) + my_id, most);
      }
    }
    const int entry = group * renderer::cuda::kWarp + lane;
    if (entry >= done && entry < done + chunk) walk.hits[entry] = my_hits;
    live = __any_sync(renderer::cuda::kAllLanes, walk.open);
  }
  shared.staged.wait();  // For a group that no one needed.
  walk.read = static_cast<std::uint32_t>(min(group * renderer::cuda::kWarp, done + chunk));
}

__device__ void write_pixel(const TrainingImages<float>& images, std::size_t at,
                            const PixelSums<float>& sums) {
  images.rgb[3 * at] = sums.rgb.x;
  images.rgb[3 * at + 1] = sums.rgb.y;
  images.rgb[3 * at + 2] = sums.rgb.z;
  images.depth_m[at] = sums.depth_m;
  images.alpha[at] = 1.0F - sums.transmittance;
  images.normal[3 * at] = sums.normal.x;
  images.normal[3 * at + 1] = sums.normal.y;
  images.normal[3 * at + 2] = sums.normal.z;
  images.median_m[at] = sums.median_m;
  if (images.distortion != nullptr) images.distortion[at] = distortion_of(sums);
}

/// Cuts what the quarters have read into segments for backward(). One thread a quarter.
__device__ void add_items(const TrainingView& view, std::uint32_t tile,
                          std::uint32_t quarter) {
  const std::uint32_t* read = view.read_count + kParts * tile + 2 * quarter;
  const std::uint32_t segments = (max(read[0], read[1]) + kSegment - 1) / kSegment;
  const std::uint32_t at = atomicAdd(&view.queue[kItems], segments);
  for (std::uint32_t s = 0; s < segments; ++s) view.item[at + s] = {tile, quarter, s};
}

/// The block enters and leaves it together.
__device__ void draw_tile(const ForwardJob& job, ForwardShared& shared, int tile) {
  const TrainingView& view = job.view;
  const renderer::cuda::FrameView& frame = view.frame;
  const int thread = static_cast<int>(threadIdx.x), lane = renderer::cuda::lane_index();
  const std::uint32_t listed = frame.count[tile];
  if (thread == 0) {
    shared.base = atomicAdd(&view.queue[kPairsTaken], listed);
    shared.segment_base =
        atomicAdd(&view.queue[kSegmentsTaken], (listed + kSegment - 1) / kSegment);
    view.list_base[tile] = shared.base;
    view.segment_base[tile] = shared.segment_base;
  }
  __syncthreads();
  const std::uint32_t base = shared.base;
  // The host sees that either did not fit, and draws again.
  const bool fits = listed <= frame.capacity && base + listed <= view.pair_capacity;
  const int count = fits ? static_cast<int>(listed) : 0;
  const renderer::cuda::ListKey* list =
      frame.bucket + static_cast<std::size_t>(tile) * frame.capacity;

  PartWalk walk;
  walk.part = thread / renderer::cuda::kWarp;
  walk.first = first_pixel_of(frame, tile, walk.part);
  const PixelPlace at = pixel_of(walk.first, lane);
  walk.x_px = static_cast<float>(at.x) + 0.5F, walk.y_px = static_cast<float>(at.y) + 0.5F;
  walk.hits =
      view.hits + std::size_t{kParts} * base + static_cast<std::size_t>(walk.part) * listed;
  walk.segment_state = view.segment_state + state_place(shared.segment_base, walk.part, lane);
  walk.sums = {};
  walk.open = in_image(frame, at);
  walk.read = 0;

  bool tile_live = true;
  int done = 0;
  renderer::cuda::ListKey next = 0;
  while (tile_live) {
    const int chunk =
        renderer::cuda::next_chunk<kThreads>(shared.list, list, count, done, next);
    if (chunk == 0) break;
    for (int i = thread; i < chunk; i += kThreads) {
      view.sorted[base + done + i] = shared.list.sorted(i);
    }
    if (__any_sync(renderer::cuda::kAllLanes, walk.open))
      blend_chunk(job, shared, chunk, done, walk);
    done += chunk;
    tile_live = __syncthreads_or(walk.open ? 1 : 0) != 0;
  }
  if (lane == 0) view.read_count[kParts * tile + walk.part] = walk.read;
  save_sums(view.state + state_place(static_cast<std::uint32_t>(tile), walk.part, lane),
            walk.sums);
  if (in_image(frame, at)) {
    write_pixel(job.images, static_cast<std::size_t>(at.y) * frame.width_px + at.x, walk.sums);
  }
  __syncthreads();
  if (thread < kQuarters) {
    add_items(view, static_cast<std::uint32_t>(tile), static_cast<std::uint32_t>(thread));
  }
}

__global__ void __launch_bounds__(kThreads, 4) draw_tiles(ForwardJob job) {
  // More than a block gets without asking: see launch_forward().
  extern __shared__ float4 shared_bytes[];
  ForwardShared& shared = *reinterpret_cast<ForwardShared*>(shared_bytes);
  const renderer::cuda::FrameView& frame = job.view.frame;
  const auto tiles = static_cast<std::uint32_t>(frame.tiles_x * frame.tiles_y);
  while (true) {
    if (threadIdx.x == 0) {
      const std::uint32_t at = atomicAdd(&frame.queue[0], 1U);
      shared.tile = at < tiles ? static_cast<int>(frame.order[at]) : -1;
    }
    __syncthreads();
    const int tile = shared.tile;
    if (tile < 0) return;
    draw_tile(job, shared, tile);
    __syncthreads();
  }
}

}  // namespace

void launch_forward(const TrainingView& view, const TrainingImages<float>& images,
                    float* max_weight, cudaStream_t stream) {
  const int tiles = view.frame.tiles_x * view.frame.tiles_y;
  constexpr int kBytes = sizeof(ForwardShared);
  renderer::cuda::throw_on_error(
      cudaFuncSetAttribute(draw_tiles, cudaFuncAttributeMaxDynamicSharedMemorySize, kBytes),
      "cudaFuncSetAttribute");
  const int blocks = renderer::cuda::resident_blocks(reinterpret_cast<const void*>(draw_tiles),
                                                     kThreads, kBytes);
  draw_tiles<<<min(blocks, tiles), kThreads, kBytes, stream>>>({view, images, max_weight});
  renderer::cuda::throw_on_error(cudaGetLastError(), "draw_tiles");
}

}  // namespace segsim::reconstruction::cuda
