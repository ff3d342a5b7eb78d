#pragma once

/// @file
/// A lane's two pixels while surfels are blended into them.

#include <cuda_fp16.h>

#include "renderer/cuda/kernels.h"
#include "renderer/cuda/selection.cuh"
#include "renderer/cuda/tile_shared.cuh"
#include "renderer/cuda/warp.cuh"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::cuda {

constexpr int kQuarterPx = kTilePx / 2;

constexpr float kLog2E = 1.44269504F;
constexpr float kLog2Of255 = 7.99435344F;

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

/// Number of a thread's pixel in the block.
__device__ inline int pixel_of_thread(int p) {
  return p * kTileThreads + static_cast<int>(threadIdx.x);
}

template <bool kRgb, bool kNormal, int kKeys>
struct Quarter {
  Pixel<kKeys> pixel[2];
  float x_px, y_px;  ///< Of the first pixel's centre.
  /// Of many keys: what pixels selected in chunks before, indices in the cloud.
  std::uint32_t earlier[2][kKeys == kManyKeys ? kManyKeys : 1];
  std::uint32_t contributions = 0;  ///< Of the warp.

  /// Blends entry `i` of a buffer. @param place  Of the entry in the chunk.
  __device__ void blend(const RasterJob& job, TileShared& shared, int buffer, int i,
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
#pragma unroll
      for (int p = 0; p < 2; ++p) {
        pixel[p].keys.insert(weight[p],
                             static_cast<std::uint32_t>(Keys<kKeys>::kPlaces + place), shared,
                             pixel_of_thread(p), job.frame);
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
