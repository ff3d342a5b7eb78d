/// @file
/// Once per surfel: sums over pixels -> derivatives by the parameters.

#include "reconstruction/rasterizer/cuda/staged_sh.cuh"
#include "reconstruction/rasterizer/cuda/training_data.h"
#include "reconstruction/rasterizer/surfel_activation.h"

namespace segsim::reconstruction::cuda {
namespace {

constexpr int kThreads = 128;

__device__ LocalGradient<float> take_sums(const TrainingView& view, std::uint32_t id) {
  float v[kSums];
  auto* sum = reinterpret_cast<float4*>(view.sum + std::size_t{kSums} * id);
#pragma unroll
  for (int word = 0; word < kSums / 4; ++word) {
    reinterpret_cast<float4*>(v)[word] = sum[word];
    sum[word] = make_float4(0, 0, 0, 0);
  }
  LocalGradient<float> g;
  g.m00 = v[0], g.m01 = v[1], g.m10 = v[2], g.m11 = v[3];
  g.g0 = v[4], g.g1 = v[5], g.x0 = v[6], g.y0 = v[7], g.z0 = v[8];
  g.log_opacity = v[9];
  g.colour = {v[10], v[11], v[12]};
  g.normal = {v[13], v[14], v[15]};
  g.reach = view.reach_sum[id];
  view.reach_sum[id] = 0.0F;
  return g;
}

/// The arrays of surfel i alone.
__device__ SurfelParameters<float> one_surfel(SurfelParameters<float> s, std::int64_t i,
                                              const float* sh) {
  s.count = 1;
  s.position_m += 3 * i, s.log_scale += 2 * i, s.rotation += 4 * i, s.opacity_logit += i;
  s.sh = sh;
  return s;
}

__device__ SurfelGradients<float> one_surfel(SurfelGradients<float> g, std::int64_t i,
                                             float* sh) {
  g.position_m += 3 * i, g.log_scale += 2 * i, g.rotation += 4 * i, g.opacity_logit += i;
  if (g.screen != nullptr) g.screen += i;
  g.sh = sh;
  return g;
}

template <int kDegree>
__global__ void __launch_bounds__(kThreads, 4)
    write_surfels(TrainingView view, SurfelParameters<float> surfels, std::uint32_t count,
                  SurfelGradients<float> gradients) {
  __shared__ StagedSh<kDegree> staged[kThreads / renderer::cuda::kWarp];
  StagedSh<kDegree>& sh = staged[threadIdx.x / renderer::cuda::kWarp];
  const auto place = static_cast<std::uint32_t>(blockIdx.x * kThreads + threadIdx.x);
  const unsigned lanes = __ballot_sync(renderer::cuda::kAllLanes, place < count);
  const std::uint32_t id = place < count ? view.visible[place] : 0U;
  LocalGradient<float> sums;
  if (place < count) sums = take_sums(view, id);
  sh.load(surfels.sh, lanes, id);
  if (place < count) {
    SurfelParameters<float> mine = one_surfel(surfels, id, sh.row());
    mine.sh_degree = kDegree;
    // Degrees that the compiler knows: coefficients then stay in registers.
    with_known_degree<kDegree>(surfels.active_sh_degree, [&](auto active) {
      mine.active_sh_degree = decltype(active)::value;
      // The gradients take the place of the coefficients.
      write_gradients(mine, 0, view.camera.pinhole, view.frame.width_px, view.frame.height_px,
                      sums, one_surfel(gradients, id, sh.row()));
    });
  }
  sh.store(gradients.sh, lanes, id);
}

}  // namespace

void launch_gradients(const TrainingView& view, const SurfelParameters<float>& surfels,
                      std::uint32_t visible_count, const SurfelGradients<float>& gradients,
                      cudaStream_t stream) {
  const auto clear = [&](float* values, std::size_t a_surfel) {
    if (values == nullptr || surfels.count == 0) return;
    const std::size_t bytes =
        static_cast<std::size_t>(surfels.count) * a_surfel * sizeof(float);
    renderer::cuda::throw_on_error(cudaMemsetAsync(values, 0, bytes, stream),
                                   "cudaMemsetAsync");
  };
  const int degree = surfels.sh_degree;
  clear(gradients.position_m, 3);
  clear(gradients.log_scale, 2);
  clear(gradients.rotation, 4);
  clear(gradients.opacity_logit, 1);
  clear(gradients.sh, static_cast<std::size_t>(3 * (degree + 1) * (degree + 1)));
  clear(gradients.screen, 1);
  if (visible_count == 0) return;
  const unsigned blocks = (visible_count + kThreads - 1) / kThreads;
  with_degree<3>(degree, [&](auto stored) {
    write_surfels<decltype(stored)::value>
        <<<blocks, kThreads, 0, stream>>>(view, surfels, visible_count, gradients);
  });
  renderer::cuda::throw_on_error(cudaGetLastError(), "write_surfels");
}

}  // namespace segsim::reconstruction::cuda
