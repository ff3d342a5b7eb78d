/// @file
/// Derivatives by the images -> sums over each surfel's pixels. A warp takes a quarter of a
/// tile and walks a segment of its list front to back, from the sums that forward saved before
/// it. The pixels into which a surfel was blended, mostly few of 64, are dealt out to the
/// lanes; the warp's 32 x 16 values then become 16 sums by exchanging halves: 16 shuffles,
/// not 80.

#include "reconstruction/rasterizer/cuda/tile_parts.cuh"

namespace segsim::reconstruction::cuda {
namespace {

struct BackwardJob {
  TrainingView view;
  TrainingImages<const float> loss;
};

__device__ PixelLoss<float> loss_at(const TrainingImages<const float>& loss, std::size_t at) {
  const auto scalar = [at](const float* image) { return image != nullptr ? image[at] : 0.0F; };
  const auto vector = [at](const float* image) {
    return image != nullptr
               ? renderer::Vec3<float>{image[3 * at], image[3 * at + 1], image[3 * at + 2]}
               : renderer::Vec3<float>{0.0F, 0.0F, 0.0F};
  };
  return {vector(loss.rgb), scalar(loss.depth_m), scalar(loss.alpha), vector(loss.normal),
          scalar(loss.distortion)};
}

constexpr int kThreads = kQuarters * renderer::cuda::kWarp;

/// The pixels of a warp's quarter; pixel p is (p % 8, p / 8) of it.
struct QuarterPixels {
  static constexpr int kPixels = 2 * renderer::cuda::kWarp;
  float4 rgb_depth[kPixels];     ///< Loss's derivatives by colour and depth,
  float4 normal_alpha[kPixels];  ///< by normal and alpha,
  float4 distortion[kPixels];    ///< by distortion; then alpha, m1, m2.
  float2 running[kPixels];       ///< PixelAdjoint::transmittance, remaining.
  float first_inverse_depth[kPixels];
  std::uint8_t dealt[kPixels];  ///< Pixels of the present surfel.

  __device__ void put(int p, const PixelAdjoint<float>& a) {
    const PixelLoss<float>& l = a.loss;
    rgb_depth[p] = make_float4(l.rgb.x, l.rgb.y, l.rgb.z, l.depth_m);
    normal_alpha[p] = make_float4(l.normal.x, l.normal.y, l.normal.z, l.alpha);
    distortion[p] = make_float4(l.distortion, a.alpha, a.m1, a.m2);
    running[p] = make_float2(a.transmittance, a.remaining);
    first_inverse_depth[p] = a.first_inverse_depth;
  }
  __device__ PixelAdjoint<float> get(int p) const {
    const float4 r = rgb_depth[p], n = normal_alpha[p], d = distortion[p];
    const float2 now = running[p];
    return {{{r.x, r.y, r.z}, r.w, n.w, {n.x, n.y, n.z}, d.x},
            d.y,
            d.z,
            d.w,
            first_inverse_depth[p],
            now.x,
            now.y};
  }

  /// Fills `dealt`. @return  Pixels dealt out.
  __device__ int deal(unsigned hits0, unsigned hits1) {
    const int lane = renderer::cuda::lane_index();
    const unsigned before = (1U << lane) - 1U;
    const int first = __popc(hits0);
    if ((hits0 >> lane & 1U) != 0) {
      dealt[__popc(hits0 & before)] = static_cast<std::uint8_t>(lane);
    }
    if ((hits1 >> lane & 1U) != 0) {
      dealt[first + __popc(hits1 & before)] =
          static_cast<std::uint8_t>(renderer::cuda::kWarp + lane);
    }
    __syncwarp();
    return first + __popc(hits1);
  }

  /// Adds what pixel p contributes to a surfel that was blended into it.
  __device__ void add(int p, const DrawnSurfel<float>& s, float x_px, float y_px,
                      LocalGradient<float>& sum) {
    SurfelHit<float> hit;
    if (!meet_surfel(s, x_px + static_cast<float>(p % kPartWidthPx),
                     y_px + static_cast<float>(p / kPartWidthPx), hit)) {
      return;
    }
    PixelAdjoint<float> pixel = get(p);
    const HitGradient<float> by = unblend_hit(s, hit, pixel);
    running[p] = make_float2(pixel.transmittance, pixel.remaining);
    add_hit_gradient(s, hit, pixel.loss, by, sum);
  }
};

struct WalkShared {
  StagedSurfels<kThreads> staged;
  QuarterPixels pixels[kThreads / renderer::cuda::kWarp];
};

/// Halves the values that a lane holds: it keeps one half, of itself and of lane ^ kStep.
template <int kStep>
__device__ void fold(float* v) {
  const bool upper = (renderer::cuda::lane_index() & kStep) != 0;
  constexpr int kHalf = kStep / 2;
#pragma unroll
  for (int i = 0; i < kHalf; ++i) {
    const float mine = upper ? v[i + kHalf] : v[i];
    const float theirs = upper ? v[i] : v[i + kHalf];
    v[i] = mine + __shfl_xor_sync(renderer::cuda::kAllLanes, theirs, kStep);
  }
}

/// Sums over the warp: lane l returns that of value l / 2.
__device__ float sums_of_warp(const LocalGradient<float>& g) {
  float v[kSums] = {g.m00,      g.m01,      g.m10,      g.m11,         g.g0,       g.g1,
                    g.x0,       g.y0,       g.z0,       g.log_opacity, g.colour.x, g.colour.y,
                    g.colour.z, g.normal.x, g.normal.y, g.normal.z};
  static_assert(kSums == 16);
  fold<16>(v);
  fold<8>(v);
  fold<4>(v);
  fold<2>(v);
  return v[0] + __shfl_xor_sync(renderer::cuda::kAllLanes, v[0], 1);
}

__device__ float sum_of_warp(float value) {
#pragma unroll
  for (int step = renderer::cuda::kWarp / 2; step > 0; step /= 2) {
    value += __shfl_xor_sync(renderer::cuda::kAllLanes, value, step);
  }
  return value;
}

/// Where a surfel's sums over a quarter go.
template <bool kFixedOrder>
__device__ void put_sums(const TrainingView& view, std::uint32_t id, std::size_t place,
                         const LocalGradient<float>& g) {
  const int lane = renderer::cuda::lane_index();
  const float sum = sums_of_warp(g);
  const bool reaches = __any_sync(renderer::cuda::kAllLanes, g.reach != 0.0F);
  const float reach = reaches ? sum_of_warp(g.reach) : 0.0F;
  if constexpr (kFixedOrder) {
    if (lane % 2 == 0) view.part[kSums * place + lane / 2] = sum;
    if (lane == 1) view.part_reach[place] = reach;
  } else {
    if (lane % 2 == 0) atomicAdd(view.sum + std::size_t{kSums} * id + lane / 2, sum);
    if (lane == 1 && reaches) atomicAdd(view.reach_sum + id, reach);
  }
}

/// A segment of a quarter's list.
struct Segment {
  std::uint32_t begin, end;    ///< Entries.
  std::uint32_t read[2];       ///< Entries that the quarter's halves have looked at.
  std::size_t hits[2];         ///< Place of the halves' first entries.
  std::size_t parts;           ///< Place of the quarter's first entry.
  std::uint32_t sorted_first;  ///< Place of the tile's first entry.
};

__device__ Segment segment_of(const TrainingView& view, const WalkItem& item) {
  const auto quarter = static_cast<int>(item.quarter);
  const std::uint32_t* read = view.read_count + kParts * item.tile + 2 * item.quarter;
  Segment s;
  s.read[0] = read[0], s.read[1] = read[1];
  s.begin = item.segment * kSegment;
  s.end = min(s.begin + kSegment, max(s.read[0], s.read[1]));
  s.hits[0] = hits_place(view, item.tile, 2 * quarter);
  s.hits[1] = hits_place(view, item.tile, 2 * quarter + 1);
  s.parts = parts_place(view, item.tile, quarter);
  s.sorted_first = view.list_base[item.tile];
  return s;
}

struct Entry {
  HitMask hits[2];  ///< In the quarter's halves.
  std::uint32_t id;
  [[nodiscard]] __device__ bool counts() const { return (hits[0] | hits[1]) != 0; }
};

/// A lane's entry of the group of 32 that begins at `first`.
__device__ Entry entry_of(const TrainingView& view, const Segment& s, std::uint32_t first) {
  const std::uint32_t entry = first + static_cast<std::uint32_t>(renderer::cuda::lane_index());
  Entry e{{0, 0}, 0};
  if (entry >= s.end) return e;
  if (entry < s.read[0]) e.hits[0] = view.hits[s.hits[0] + entry];
  if (entry < s.read[1]) e.hits[1] = view.hits[s.hits[1] + entry];
  if (e.counts()) {
    e.id = static_cast<std::uint32_t>(view.sorted[s.sorted_first + entry]) >>
           renderer::cuda::kQuarterBits;
  }
  return e;
}

/// Pixels of the quarter before the segment's first surfel.
__device__ void begin_pixels(const BackwardJob& job, const WalkItem& item, const Segment& s,
                             QuarterPixels& pixels) {
  const TrainingView& view = job.view;
  const renderer::cuda::FrameView& frame = view.frame;
  const int lane = renderer::cuda::lane_index();
#pragma unroll
  for (int half = 0; half < 2; ++half) {
    const int part = static_cast<int>(2 * item.quarter) + half;
    const PixelPlace at =
        pixel_of(first_pixel_of(frame, static_cast<int>(item.tile), part), lane);
    // A half that ended before has no sums here, and no hits.
    if (s.read[half] <= s.begin) continue;
    PixelLoss<float> loss{};
    if (in_image(frame, at)) {
      loss = loss_at(job.loss, static_cast<std::size_t>(at.y) * frame.width_px + at.x);
    }
    const auto all = load_sums(view.state + state_place(item.tile, part, lane));
    const std::uint32_t saved = view.segment_base[item.tile] + item.segment;
    const auto before = load_sums(view.segment_state + state_place(saved, part, lane));
    pixels.put(half * renderer::cuda::kWarp + lane, begin_adjoint(loss, all, before));
  }
}

template <bool kFixedOrder>
__device__ void walk_segment(const BackwardJob& job, WalkShared& shared,
                             const WalkItem& item) {
  const TrainingView& view = job.view;
  const int lane = renderer::cuda::lane_index(),
            warp_first = static_cast<int>(threadIdx.x) - lane;
  const Segment segment = segment_of(view, item);
  QuarterPixels& pixels = shared.pixels[warp_first / renderer::cuda::kWarp];
  __syncwarp();
  begin_pixels(job, item, segment, pixels);
  const PixelPlace first = first_pixel_of(view.frame, static_cast<int>(item.tile),
                                          static_cast<int>(2 * item.quarter));
  const float x_px = static_cast<float>(first.x) + 0.5F;
  const float y_px = static_cast<float>(first.y) + 0.5F;
  Entry here = entry_of(view, segment, segment.begin);
  if (here.counts()) shared.staged.copy(0, view.drawn[here.id]);
  Entry next = entry_of(view, segment, segment.begin + renderer::cuda::kWarp);
  int buffer = 0;
  for (std::uint32_t group = segment.begin; group < segment.end;
       group += renderer::cuda::kWarp) {
    shared.staged.wait();
    __syncwarp();
    if (next.counts()) shared.staged.copy(buffer ^ 1, view.drawn[next.id]);
    const Entry mine = here;
    here = next;
    next = entry_of(view, segment, group + 2 * renderer::cuda::kWarp);
    unsigned todo = __ballot_sync(renderer::cuda::kAllLanes, mine.counts());
    while (todo != 0) {
      const int i = __ffs(static_cast<int>(todo)) - 1;
      todo &= todo - 1;
      const int count = pixels.deal(__shfl_sync(renderer::cuda::kAllLanes, mine.hits[0], i),
                                    __shfl_sync(renderer::cuda::kAllLanes, mine.hits[1], i));
      const std::uint32_t id = __shfl_sync(renderer::cuda::kAllLanes, mine.id, i);
      const DrawnSurfel<float> s = shared.staged.read(buffer, warp_first + i);
      LocalGradient<float> sum;
      for (int k = lane; k < count; k += renderer::cuda::kWarp) {
        pixels.add(pixels.dealt[k], s, x_px, y_px, sum);
      }
      __syncwarp();
      put_sums<kFixedOrder>(view, id, segment.parts + group + i, sum);
    }
    buffer ^= 1;
  }
}

template <bool kFixedOrder>
__global__ void __launch_bounds__(kThreads, 6) walk_segments(BackwardJob job) {
  __shared__ WalkShared shared;
  const TrainingView& view = job.view;
  const std::uint32_t items = view.queue[kItems];
  while (true) {
    // Warps do not wait for one another.
    std::uint32_t at = 0;
    if (renderer::cuda::lane_index() == 0) at = atomicAdd(&view.queue[kNextItem], 1U);
    at = __shfl_sync(renderer::cuda::kAllLanes, at, 0);
    if (at >= items) return;
    walk_segment<kFixedOrder>(job, shared, view.item[at]);
  }
}

/// Where a pair's key lies in a tile's sorted list.
/// @return  `read` if it is not among the first `read`.
__device__ std::uint32_t find_key(const renderer::cuda::ListKey* sorted, std::uint32_t read,
                                  renderer::cuda::ListKey key) {
  std::uint32_t first = 0, count = read;
  while (count > 0) {
    const std::uint32_t half = count / 2;
    if (sorted[first + half] >> renderer::cuda::kQuarterBits < key) {
      first += half + 1;
      count -= half + 1;
    } else {
      count = half;
    }
  }
  return first < read && sorted[first] >> renderer::cuda::kQuarterBits == key ? first : read;
}

constexpr int kGatherLanes = 8;  ///< Lanes that share a surfel's tiles.

/// Sums of a surfel's parts: tiles in the order of the image, then quarters; lane l takes
/// every eighth tile.
__global__ void gather_parts(TrainingView view, std::uint32_t visible_count) {
  const auto thread = static_cast<std::uint32_t>(blockIdx.x * blockDim.x + threadIdx.x);
  const std::uint32_t place = thread / kGatherLanes;
  const int lane = static_cast<int>(thread % kGatherLanes);
  const bool any = place < visible_count;
  float sum[kSums] = {}, reach = 0.0F;
  const std::uint32_t id = any ? view.visible[place] : 0U;
  if (any) {
    const SurfelPixels p = view.pixels[id];
    const int x_begin = p.x_lo / renderer::cuda::kTilePx,
              y_begin = p.y_lo / renderer::cuda::kTilePx;
    const int width = p.x_hi / renderer::cuda::kTilePx + 1 - x_begin;
    const int count = width * (p.y_hi / renderer::cuda::kTilePx + 1 - y_begin);
    const auto key =
        static_cast<renderer::cuda::ListKey>(__float_as_uint(view.drawn[id].surfel.z0_m))
            << 28U |
        id;
    for (int t = lane; t < count; t += kGatherLanes) {
      const auto tile = static_cast<std::uint32_t>((y_begin + t / width) * view.frame.tiles_x +
                                                   x_begin + t % width);
      const std::uint32_t* read = view.read_count + kParts * tile;
      std::uint32_t most = 0;
      for (int part = 0; part < kParts; ++part) most = max(most, read[part]);
      const std::uint32_t entry = find_key(view.sorted + view.list_base[tile], most, key);
      if (entry == most) continue;
      for (int quarter = 0; quarter < kQuarters; ++quarter) {
        HitMask hits = 0;
        for (int part = 2 * quarter; part < 2 * quarter + 2; ++part) {
          if (entry < read[part]) hits |= view.hits[hits_place(view, tile, part) + entry];
        }
        if (hits == 0) continue;
        const std::size_t at = parts_place(view, tile, quarter) + entry;
#pragma unroll
        for (int k = 0; k < kSums; ++k) sum[k] += view.part[kSums * at + k];
        reach += view.part_reach[at];
      }
    }
  }
#pragma unroll
  for (int step = 1; step < kGatherLanes; step *= 2) {
#pragma unroll
    for (float& value : sum) value += __shfl_xor_sync(renderer::cuda::kAllLanes, value, step);
    reach += __shfl_xor_sync(renderer::cuda::kAllLanes, reach, step);
  }
  if (!any || lane != 0) return;
#pragma unroll
  for (int k = 0; k < kSums; ++k) view.sum[std::size_t{kSums} * id + k] = sum[k];
  view.reach_sum[id] = reach;
}

template <bool kFixedOrder>
void launch_walk(const BackwardJob& job, cudaStream_t stream) {
  const int blocks = renderer::cuda::resident_blocks(
      reinterpret_cast<const void*>(walk_segments<kFixedOrder>), kThreads);
  renderer::cuda::throw_on_error(
      cudaMemsetAsync(job.view.queue + kNextItem, 0, sizeof(std::uint32_t), stream),
      "cudaMemsetAsync");
  walk_segments<kFixedOrder><<<blocks, kThreads, 0, stream>>>(job);
  renderer::cuda::throw_on_error(cudaGetLastError(), "walk_segments");
}

}  // namespace

void launch_backward(const TrainingView& view, const TrainingImages<const float>& loss,
                     std::uint32_t visible_count, cudaStream_t stream) {
  if (view.part == nullptr) {
    launch_walk<false>({view, loss}, stream);
    return;
  }
  launch_walk<true>({view, loss}, stream);
  constexpr std::uint32_t kSurfels = kThreads / kGatherLanes;
  if (visible_count == 0) return;
  gather_parts<<<(visible_count + kSurfels - 1) / kSurfels, kThreads, 0, stream>>>(
      view, visible_count);
  renderer::cuda::throw_on_error(cudaGetLastError(), "gather_parts");
}

}  // namespace segsim::reconstruction::cuda
