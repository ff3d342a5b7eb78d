/// @file
/// Blending weights of listed pixels as compressed rows: count, scan, fill, keep the heaviest.

#include <cub/device/device_scan.cuh>

#include "reconstruction/rasterizer/cuda/tile_parts.cuh"

namespace segsim::reconstruction::cuda {
namespace {

constexpr int kThreads = 128;

/// What a pixel's walk through its tile's list needs.
struct PixelWalk {
  int tile, part, x, y;
  HitMask bit;  ///< Of the pixel in its part's masks.
};

__device__ PixelWalk walk_of(const renderer::cuda::FrameView& frame, std::int32_t pixel) {
  PixelWalk walk;
  walk.x = pixel % frame.width_px, walk.y = pixel / frame.width_px;
  walk.tile =
      walk.y / renderer::cuda::kTilePx * frame.tiles_x + walk.x / renderer::cuda::kTilePx;
  const int in_x = walk.x % renderer::cuda::kTilePx, in_y = walk.y % renderer::cuda::kTilePx;
  const int row = in_y / kPartHeightPx;
  walk.part = row / 2 * 4 + in_x / kPartWidthPx * 2 + row % 2;
  walk.bit = HitMask{1} << (in_y % kPartHeightPx * kPartWidthPx + in_x % kPartWidthPx);
  return walk;
}

__device__ bool is_in_image(const renderer::cuda::FrameView& frame, std::int32_t pixel) {
  return pixel >= 0 && pixel < frame.width_px * frame.height_px;
}

/// One thread a pixel.
__global__ void count_weights(TrainingView view, WeightTable table) {
  const std::int64_t p = static_cast<std::int64_t>(blockIdx.x) * kThreads + threadIdx.x;
  if (p > table.pixels) return;
  std::int32_t count = 0;
  if (p < table.pixels) {
    if (is_in_image(view.frame, table.pixel[p])) {
      const PixelWalk walk = walk_of(view.frame, table.pixel[p]);
      const std::uint32_t read = view.read_count[kParts * walk.tile + walk.part];
      const HitMask* hits = view.hits + hits_place(view, walk.tile, walk.part);
      for (std::uint32_t i = 0; i < read; ++i) count += (hits[i] & walk.bit) != 0 ? 1 : 0;
    } else {
      atomicAdd(table.bad_pixels, 1);
    }
  }
  table.all_start[p] = count;
  table.row_start[p] =
      table.max_per_pixel > 0 && count > table.max_per_pixel ? table.max_per_pixel : count;
}

/// One thread a pixel: its whole row.
__global__ void fill_weights(TrainingView view, WeightTable table) {
  const std::int64_t p = static_cast<std::int64_t>(blockIdx.x) * kThreads + threadIdx.x;
  if (p >= table.pixels) return;
  const PixelWalk walk = walk_of(view.frame, table.pixel[p]);
  const std::uint32_t read = view.read_count[kParts * walk.tile + walk.part];
  const HitMask* hits = view.hits + hits_place(view, walk.tile, walk.part);
  const renderer::cuda::ListKey* sorted = view.sorted + view.list_base[walk.tile];
  const bool all = table.max_per_pixel == 0;
  std::int32_t* surfel = all ? table.surfel : table.all_surfel;
  float* weight = all ? table.weight : table.all_weight;
  std::int32_t at = table.all_start[p];
  float transmittance = 1.0F;
  for (std::uint32_t i = 0; i < read; ++i) {
    if ((hits[i] & walk.bit) == 0) continue;
    const auto id = static_cast<std::uint32_t>(sorted[i]) >> renderer::cuda::kQuarterBits;
    SurfelHit<float> hit;
    hit.alpha = 0.0F;
    meet_surfel(view.drawn[id].surfel, static_cast<float>(walk.x) + 0.5F,
                static_cast<float>(walk.y) + 0.5F, hit);
    surfel[at] = static_cast<std::int32_t>(id);
    weight[at++] = transmittance * hit.alpha;
    transmittance *= 1.0F - hit.alpha;
  }
}

/// One warp a pixel: an entry stays if fewer than max_per_pixel are heavier.
__global__ void keep_heaviest(WeightTable table) {
  const std::int64_t p =
      (static_cast<std::int64_t>(blockIdx.x) * kThreads + threadIdx.x) / renderer::cuda::kWarp;
  if (p >= table.pixels) return;
  const int lane = renderer::cuda::lane_index();
  const std::int32_t first = table.all_start[p], end = table.all_start[p + 1];
  std::int32_t at = table.row_start[p];
  for (std::int32_t group = first; group < end; group += renderer::cuda::kWarp) {
    const std::int32_t mine = group + lane;
    bool kept = mine < end;
    if (kept) {
      const float weight = table.all_weight[mine];
      const std::int32_t surfel = table.all_surfel[mine];
      int heavier = 0;
      for (std::int32_t i = first; i < end; ++i) {
        const float w = table.all_weight[i];
        heavier += w > weight || (w == weight && table.all_surfel[i] < surfel) ? 1 : 0;
      }
      kept = heavier < table.max_per_pixel;
    }
    const unsigned lanes = __ballot_sync(renderer::cuda::kAllLanes, kept);
    if (kept) {
      const std::int32_t to = at + __popc(lanes & ((1U << lane) - 1U));
      table.surfel[to] = table.all_surfel[mine];
      table.weight[to] = table.all_weight[mine];
    }
    at += __popc(lanes);
  }
}

unsigned blocks_for(std::int64_t threads) {
  return static_cast<unsigned>((threads + kThreads - 1) / kThreads);
}

void scan(void* scratch, std::size_t& bytes, std::int32_t* values, std::int64_t count,
          cudaStream_t stream) {
  renderer::cuda::throw_on_error(
      cub::DeviceScan::ExclusiveSum(scratch, bytes, values, values, count, stream),
      "cub::DeviceScan");
}

}  // namespace

std::size_t weight_scan_bytes(std::int64_t pixels) {
  std::size_t bytes = 0;
  scan(nullptr, bytes, nullptr, pixels + 1, nullptr);
  return bytes;
}

void launch_weight_rows(const TrainingView& view, const WeightTable& table, void* scratch,
                        std::size_t scratch_bytes, cudaStream_t stream) {
  renderer::cuda::throw_on_error(
      cudaMemsetAsync(table.bad_pixels, 0, sizeof(std::int32_t), stream), "cudaMemsetAsync");
  count_weights<<<blocks_for(table.pixels + 1), kThreads, 0, stream>>>(view, table);
  renderer::cuda::throw_on_error(cudaGetLastError(), "count_weights");
  scan(scratch, scratch_bytes, table.all_start, table.pixels + 1, stream);
  scan(scratch, scratch_bytes, table.row_start, table.pixels + 1, stream);
}

void launch_weight_entries(const TrainingView& view, const WeightTable& table,
                           cudaStream_t stream) {
  if (table.pixels == 0) return;
  fill_weights<<<blocks_for(table.pixels), kThreads, 0, stream>>>(view, table);
  renderer::cuda::throw_on_error(cudaGetLastError(), "fill_weights");
  if (table.max_per_pixel == 0) return;
  keep_heaviest<<<blocks_for(table.pixels * renderer::cuda::kWarp), kThreads, 0, stream>>>(
      table);
  renderer::cuda::throw_on_error(cudaGetLastError(), "keep_heaviest");
}

}  // namespace segsim::reconstruction::cuda
