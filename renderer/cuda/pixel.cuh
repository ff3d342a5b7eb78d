#pragma once

/// @file
/// A lane's two pixels while surfels are blended into them, the Top-K selection in registers,
/// and what the block keeps in shared memory for it.

#include <cuda_fp16.h>

#include "renderer/cuda/kernels.h"
#include "renderer/cuda/resolve.cuh"
#include "renderer/cuda/tile_list.cuh"
#include "renderer/cuda/warp.cuh"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::cuda {

constexpr int kQuarterPx = kTilePx / 2;
constexpr int kWarps = kTileThreads / kWarp;
static_assert(kWarps == 4 && kTilePixels == 2 * kTileThreads);

constexpr float kLog2E = 1.44269504F;
constexpr float kLog2Of255 = 7.99435344F;

/// Selection in registers: a key is a weight without the last 8 bits of its fraction and, in
/// 12 bits, 4095 - place, so that of equal weights the nearer is heavier. A place is 0 ...
/// 1023 of `earlier`, or 1024 + place in the present chunk. Weights lie in [2^-24, 1), so that
/// 28 bits above those of 2^-24 hold them.
constexpr int kFewKeys = 4;
constexpr std::uint32_t kPlaceMask = 0xFFF;
constexpr std::uint32_t kLeastWeightBits = 0x33800000;
constexpr float kAnyWeight = 1e-30F;  // That is not 0.
__device__ inline std::uint32_t key_of(float weight, std::uint32_t place) {
  const std::uint32_t bits = (__float_as_uint(weight) - kLeastWeightBits) << 4U;
  return (bits & ~kPlaceMask) | (kPlaceMask - place);
}
__device__ inline float weight_of(std::uint32_t key) {
  return __uint_as_float(((key & ~kPlaceMask) >> 4U) + kLeastWeightBits);
}
constexpr std::uint32_t kEarlier = kTilePixels * kFewKeys;
static_assert(kEarlier + kSortKeys <= kPlaceMask + 1);
/// Selection in memory: any K.
constexpr int kManyKeys = kMaxTopK;

struct TileShared {
  ListShared list;
  /// Of each warp two groups of records, word by word: one is blended while the other arrives.
  uint4 centre_m0[2][kTileThreads];  ///< x0, y0, m00, m01
  uint4 m1_g[2][kTileThreads];       ///< m10, m11, g0, g1
  uint4 depth[2][kTileThreads];      ///< c_k2, z0, e_min, e_max
  uint4 shade[2][kTileThreads];      ///< Colour and normal as halves; flags.
  std::uint32_t earlier[kEarlier];   ///< Indices in the cloud, of keys of chunks before.
  std::uint32_t ended_bits;
  std::uint32_t evaluations, contributions, fetches;
  int touched;  ///< Entries that the slowest warp has read.
  int tile;
};

struct RasterJob {
  FrameView frame;
  const SurfelRecord* record;
  const std::uint32_t* place;
  const std::uint32_t* label;
  std::size_t padded_surfels;
  PanopticView field;
  FeatureView features;
  bool redo;  ///< Only the tiles of redo_list.
};

/// For K > kFewKeys and TopKRule::kFirst.
void launch_raster_many(const RasterJob& job, cudaStream_t stream);

__device__ inline void copy_async(void* shared, const void* global) {
  const auto to = static_cast<unsigned>(__cvta_generic_to_shared(shared));
  asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(to), "l"(global) : "memory");
}
/// For the thread's own copies.
__device__ inline void wait_for_copies() { asm volatile("cp.async.wait_all;" ::: "memory"); }

/// Starts copying a surfel to the thread's place of a buffer.
__device__ inline void stage(TileShared& shared, int buffer, const SurfelRecord& record) {
  const int thread = static_cast<int>(threadIdx.x);
  const auto* words = reinterpret_cast<const uint4*>(&record);
  copy_async(&shared.centre_m0[buffer][thread], words);
  copy_async(&shared.m1_g[buffer][thread], words + 1);
  copy_async(&shared.depth[buffer][thread], words + 2);
  copy_async(&shared.shade[buffer][thread], words + 3);
}

__device__ inline float4 as_floats(const uint4& word) {
  return make_float4(__uint_as_float(word.x), __uint_as_float(word.y), __uint_as_float(word.z),
                     __uint_as_float(word.w));
}

/// Heaviest surfels of a pixel while it is blended.
template <int kKeys>
struct Keys;

template <>
struct Keys<0> {
  __device__ void clear() {}
  __device__ bool wants(float) const { return false; }
  __device__ void insert(float, std::uint32_t, std::uint32_t, const FrameView&) {}
  __device__ bool closed(float, const FrameView&) const { return true; }
  __device__ void leave_chunk(TileShared&, int) {}
};

template <>
struct Keys<kFewKeys> {
  std::uint32_t key[kFewKeys];
  float least;  ///< Weights below this change nothing.

  __device__ void clear() {
#pragma unroll
    for (std::uint32_t& k : key) k = 0;
    least = kAnyWeight;
  }
  __device__ bool wants(float weight) const { return weight >= least; }
  __device__ void insert(float weight, std::uint32_t place, std::uint32_t, const FrameView&) {
    std::uint32_t x = weight >= least ? key_of(weight, place) : 0U;
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) {
      const std::uint32_t smaller = min(key[k], x);
      key[k] = max(key[k], x);
      x = smaller;
    }
    // Of what falls on the same step nothing enters later.
    if (key[kFewKeys - 1] != 0) least = weight_of(key[kFewKeys - 1] + (kPlaceMask + 1));
  }
  /// Can no later surfel enter? A later weight is at most 0.99 T.
  __device__ bool closed(float transmittance, const FrameView& frame) const {
    const std::uint32_t last = key_at(frame.top_k - 1);
    return last != 0 && kMaxAlpha * transmittance < weight_of(last);
  }
  __device__ std::uint32_t key_at(int k) const {
    return k == 0 ? key[0] : k == 1 ? key[1] : k == 2 ? key[2] : key[3];
  }
  __device__ void leave_chunk(TileShared& shared, int pixel) {
    std::uint32_t id[kFewKeys];
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) id[k] = key[k] == 0 ? 0 : id_of(shared, key[k]);
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) {
      const auto place = static_cast<std::uint32_t>(pixel * kFewKeys + k);
      shared.earlier[place] = id[k];
      if (key[k] != 0) key[k] = (key[k] & ~kPlaceMask) | (kPlaceMask - place);
    }
  }
  __device__ static std::uint32_t id_of(const TileShared& shared, std::uint32_t key) {
    const std::uint32_t place = kPlaceMask - (key & kPlaceMask);
    return place < kEarlier ? shared.earlier[place]
                            : shared.list.id(static_cast<int>(place - kEarlier));
  }
  __device__ void select(const TileShared& shared, const FrameView& frame,
                         Selected<kFewKeys>& out) const {
#pragma unroll
    for (int k = 0; k < kFewKeys; ++k) {
      if (k >= frame.top_k || key[k] == 0) break;
      out.weight[k] = weight_of(key[k]);
      out.id[k] = id_of(shared, key[k]);
      out.total += out.weight[k];
      out.count = k + 1;
    }
  }
};

template <>
struct Keys<kManyKeys> {
  float weight[kManyKeys];
  std::uint32_t id[kManyKeys];
  int count;
  float least;  ///< Weights up to this change nothing.

  __device__ void clear() {
    count = 0;
    least = 0.0F;
  }
  __device__ bool wants(float w) const { return w > least; }
  __device__ void insert(float w, std::uint32_t, std::uint32_t surfel,
                         const FrameView& frame) {
    if (!(w > least)) return;
    int k = count;
    if (count == frame.top_k) {
      --k;
    } else {
      ++count;
    }
    if (!frame.first_hits) {
      for (; k > 0 && w > weight[k - 1]; --k) {
        weight[k] = weight[k - 1];
        id[k] = id[k - 1];
      }
    }
    weight[k] = w;
    id[k] = surfel;
    if (count == frame.top_k) least = frame.first_hits ? INFINITY : weight[count - 1];
  }
  __device__ bool closed(float transmittance, const FrameView& frame) const {
    if (count < frame.top_k) return false;
    return frame.first_hits || !(kMaxAlpha * transmittance > weight[count - 1]);
  }
  __device__ void leave_chunk(TileShared&, int) {}
  __device__ void select(const TileShared&, const FrameView&, Selected<kManyKeys>& out) const {
    for (int k = 0; k < count; ++k) {
      out.weight[k] = weight[k];
      out.id[k] = id[k];
      out.total += weight[k];
    }
    out.count = count;
  }
};

template <int kKeys>
struct Pixel {
  float transmittance;
  /// log2(255 alpha) must reach this; infinite once the pixel is finished.
  float threshold;
  float depth;
  float r, g, b, nx, ny, nz;
  Keys<kKeys> keys;

  __device__ void clear(bool inside) {
    transmittance = 1.0F;
    threshold = inside ? 0.0F : INFINITY;
    depth = r = g = b = nx = ny = nz = 0.0F;
    keys.clear();
  }
  [[nodiscard]] __device__ bool live() const { return threshold == 0.0F; }
};

__device__ inline float exp2_of(float x) {
  float y;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}
__device__ inline float inverse_of(float x) {
  float y;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}

/// Rows between a lane's two pixels.
constexpr int kPixelStep = 4;

/// log2(255 alpha) at two pixels, before the cap.
struct Exponents {
  float value[2];
  float e[2];
};

/// @param dx, dy  From the surfel's centre to the first pixel; the second is kPixelStep rows
/// below.
__device__ inline Exponents meet(float dx, float dy, const float4& a, const float4& b,
                                 const float4& c, std::uint32_t flags) {
  constexpr float kStep = kPixelStep;
  const float u0 = fmaf(a.z, dx, a.w * dy), v0 = fmaf(b.x, dx, b.y * dy);
  const float e0 = fmaf(-b.z, dx, fmaf(-b.w, dy, 1.0F));
  const float u1 = fmaf(kStep, a.w, u0), v1 = fmaf(kStep, b.y, v0);
  const float e1 = fmaf(-kStep, b.w, e0);
  const float i0 = inverse_of(e0), i1 = inverse_of(e1);
  float rho0 = fmaf(u0, u0, v0 * v0) * i0 * i0;
  float rho1 = fmaf(u1, u1, v1 * v1) * i1 * i1;
  if (flags != 0) {  // The same for all lanes.
    if ((flags & kCare) != 0) {
      if (!(e0 >= c.z && e0 <= c.w)) rho0 = INFINITY;
      if (!(e1 >= c.z && e1 <= c.w)) rho1 = INFINITY;
    }
    const float dy1 = dy + kStep, dx2 = kLog2E * dx * dx;
    // A minimum with what is not a number is the other.
    rho0 = fminf(rho0, fmaf(kLog2E * dy, dy, dx2));
    rho1 = fminf(rho1, fmaf(kLog2E * dy1, dy1, dx2));
  }
  return {{c.x - rho0, c.x - rho1}, {e0, e1}};
}

template <bool kRgb, bool kNormal, int kKeys>
struct Quarter {
  Pixel<kKeys> pixel[2];
  float x_px, y_px;                 ///< Of the first pixel's centre.
  std::uint32_t contributions = 0;  ///< Of the warp.

  /// Blends entry `i` of a buffer. @param place  Of the entry in the chunk.
  __device__ void blend(const RasterJob& job, const TileShared& shared, int buffer, int i,
                        int place) {
    const float4 a = as_floats(shared.centre_m0[buffer][i]);
    const float4 b = as_floats(shared.m1_g[buffer][i]);
    const float4 c = as_floats(shared.depth[buffer][i]);
    const uint4 d = shared.shade[buffer][i];
    const Exponents at = meet(x_px - a.x, y_px - a.y, a, b, c, d.w);
    const bool hit0 = at.value[0] >= pixel[0].threshold;
    const bool hit1 = at.value[1] >= pixel[1].threshold;
    if (!__any_sync(kAllLanes, hit0 || hit1)) return;
    float weight[2];
    bool crosses[2];
    weight[0] = take(hit0, at.value[0], pixel[0], crosses[0]);
    weight[1] = take(hit1, at.value[1], pixel[1], crosses[1]);
    if (job.frame.median_depth) {
      if (crosses[0] || crosses[1]) {  // Once a pixel.
        if (crosses[0]) pixel[0].depth = depth_at(at.e[0], c);
        if (crosses[1]) pixel[1].depth = depth_at(at.e[1], c);
      }
    } else {
      if (weight[0] > 0.0F) {
        pixel[0].depth = fmaf(weight[0], depth_at(at.e[0], c), pixel[0].depth);
      }
      if (weight[1] > 0.0F) {
        pixel[1].depth = fmaf(weight[1], depth_at(at.e[1], c), pixel[1].depth);
      }
    }
    if (job.frame.counts) {
      contributions +=
          static_cast<std::uint32_t>(__popc(__ballot_sync(kAllLanes, weight[0] > 0.0F)) +
                                     __popc(__ballot_sync(kAllLanes, weight[1] > 0.0F)));
    }
    const auto half_at = [](std::uint32_t word) {
      return __half22float2(*reinterpret_cast<const __half2*>(&word));
    };
    if (kRgb || kNormal) {
      const float2 rg = half_at(d.x), b_nx = half_at(d.y), ny_nz = half_at(d.z);
#pragma unroll
      for (int p = 0; p < 2; ++p) {
        if (kRgb) {
          pixel[p].r = fmaf(weight[p], rg.x, pixel[p].r);
          pixel[p].g = fmaf(weight[p], rg.y, pixel[p].g);
          pixel[p].b = fmaf(weight[p], b_nx.x, pixel[p].b);
        }
        if (kNormal) {
          pixel[p].nx = fmaf(weight[p], b_nx.y, pixel[p].nx);
          pixel[p].ny = fmaf(weight[p], ny_nz.x, pixel[p].ny);
          pixel[p].nz = fmaf(weight[p], ny_nz.y, pixel[p].nz);
        }
      }
    }
    if constexpr (kKeys > 0) {
      const bool wants = pixel[0].keys.wants(weight[0]) || pixel[1].keys.wants(weight[1]);
      if (!__any_sync(kAllLanes, wants)) return;
      const std::uint32_t id = kKeys == kManyKeys ? shared.list.id(place) : 0U;
#pragma unroll
      for (int p = 0; p < 2; ++p) {
        pixel[p].keys.insert(weight[p], kEarlier + static_cast<std::uint32_t>(place), id,
                             job.frame);
      }
    }
  }

  /// Weight of the surfel in the pixel; what it hides is taken from the transmittance.
  /// @param crosses  Does the pixel become a surface here?
  __device__ static float take(bool hit, float exponent, Pixel<kKeys>& pixel, bool& crosses) {
    const float alpha = fminf(exp2_of(exponent - kLog2Of255), kMaxAlpha);
    float weight = hit ? alpha * pixel.transmittance : 0.0F;
    float left = pixel.transmittance - weight;
    if (left < kStopTransmittance) {
      weight = 0.0F;
      left = pixel.transmittance;
      pixel.threshold = INFINITY;
    }
    constexpr float kHalf = 1.0F - kMinSurfaceAlpha;
    crosses = pixel.transmittance > kHalf && left <= kHalf;
    pixel.transmittance = left;
    return weight;
  }

  __device__ static float depth_at(float e, const float4& c) {
    return c.y * inverse_of(fminf(fmaxf(e, c.z), c.w));
  }

  [[nodiscard]] __device__ bool live() const { return pixel[0].live() || pixel[1].live(); }

  /// In a frame of labels alone a pixel ends when its labels are final.
  __device__ void end_closed(const FrameView& frame) {
#pragma unroll
    for (int p = 0; p < 2; ++p) {
      if (pixel[p].transmittance <= 1.0F - kMinSurfaceAlpha &&
          pixel[p].keys.closed(pixel[p].transmittance, frame)) {
        pixel[p].threshold = INFINITY;
      }
    }
  }
};

}  // namespace segsim::renderer::cuda
