/// @file
/// From parameters to the tiles' lists: a lane looks at one surfel, then the warp spreads its
/// tiles over the lanes. Compiled without contraction of a * b + c, so that the order of
/// surfels is that of every other renderer.

#include "reconstruction/rasterizer/cuda/staged_sh.cuh"
#include "reconstruction/rasterizer/cuda/training_data.h"
#include "reconstruction/rasterizer/surfel_activation.h"
#include "renderer/cuda/kernels.h"
#include "renderer/cuda/large_surfels.cuh"
#include "renderer/cuda/screen_tiles.cuh"

namespace segsim::reconstruction::cuda {
namespace {

/// @return  False if the surfel reaches no pixel.
__device__ bool project(const TrainingView& view, const SurfelParameters<float>& surfels,
                        std::int64_t i, renderer::cuda::Candidate& out,
                        renderer::cuda::PixelRange& pixels, DrawnRecord& record) {
  const renderer::cuda::FrameView& frame = view.frame;
  const renderer::ProjectionCamera<float>& camera = view.camera.pinhole;
  const renderer::Vec3<float> position = load_vec3(surfels.position_m, i);
  out.z0_m = renderer::depth_of_centre(camera, position);
  if (!(out.z0_m > frame.near_m)) return false;
  constexpr float kLargestExtent = 3.33F;  // sqrt(2 ln 255), opacity 1.
  const float radius_m =
      kLargestExtent * expf(fmaxf(surfels.log_scale[2 * i], surfels.log_scale[2 * i + 1]));
  if (!renderer::cuda::sphere_in_view(
          frame.near_m, view.camera,
          make_float4(position.x, position.y, position.z, radius_m))) {
    return false;
  }
  const float k2 = renderer::extent_squared(active_opacity(surfels.opacity_logit[i]));
  if (!(k2 > 0.0F)) return false;
  const ActiveSurfel<float> active = activate(surfels, i);
  const renderer::SurfelProjection<float> s =
      renderer::project_surfel(camera, position, scaled(active.t_u, active.scale_u_m),
                               scaled(active.t_v, active.scale_v_m));
  // A parameter that is not a number; with_low_pass() below would make a box of it.
  if (!isfinite((s.a0 + s.a1) + (s.b0 + s.b1) + (s.w0 + s.w1) + k2)) return false;
  const bool clipped =
      renderer::crosses_near_plane(s, k2 * renderer::kBoundSlack, frame.near_m);
  const renderer::ScreenBox<float> box =
      renderer::cuda::bound_on_screen(s, k2, frame.near_m, clipped, out.outline);
  if (!renderer::cuda::find_pixels(frame, box, pixels)) return false;
  renderer::cuda::set_tiles(pixels, out);
  out.rule = clipped ? renderer::cuda::TilesRule::kAll : renderer::cuda::TilesRule::kQuarters;
  out.x0_px = s.x0_px, out.y0_px = s.y0_px;
  out.low_pass_radius2 = 0.5F * (k2 * renderer::kBoundSlack);
  record.surfel = drawn_surfel(active, s, k2, frame.near_m, camera);
  return true;
}

__device__ void store(const TrainingView& view, std::int64_t i, const DrawnRecord& record,
                      const renderer::cuda::PixelRange& p) {
  const auto* from = reinterpret_cast<const float4*>(&record);
  auto* to = reinterpret_cast<float4*>(view.drawn + i);
#pragma unroll
  for (int word = 0; word < kRecordWords; ++word) to[word] = from[word];
  const auto narrow = [](int pixel) { return static_cast<std::uint16_t>(pixel); };
  view.pixels[i] = {narrow(p.x_lo), narrow(p.x_hi), narrow(p.y_lo), narrow(p.y_hi)};
  auto* sum = reinterpret_cast<float4*>(view.sum + kSums * i);
#pragma unroll
  for (int word = 0; word < kSums / 4; ++word) sum[word] = make_float4(0, 0, 0, 0);
  view.reach_sum[i] = 0.0F;
}

template <int kDegree>
__global__ void __launch_bounds__(renderer::cuda::kProjectThreads)
    project_surfels(TrainingView view, SurfelParameters<float> surfels) {
  __shared__ StagedSh<kDegree> staged[renderer::cuda::kProjectThreads / renderer::cuda::kWarp];
  StagedSh<kDegree>& sh = staged[threadIdx.x / renderer::cuda::kWarp];
  const std::int64_t i =
      static_cast<std::int64_t>(blockIdx.x) * renderer::cuda::kProjectThreads +
      static_cast<int>(threadIdx.x);
  renderer::cuda::Candidate candidate{};
  renderer::cuda::PixelRange pixels{};
  DrawnRecord record{};
  bool drawn = i < surfels.count && project(view, surfels, i, candidate, pixels, record);
  const unsigned drawn_lanes = __ballot_sync(renderer::cuda::kAllLanes, drawn);
  if (drawn_lanes == 0) return;
  const auto id = static_cast<std::uint32_t>(i);
  unsigned long long first = 0;
  if (renderer::cuda::lane_index() == 0) {
    first = atomicAdd(&view.frame.status->surfels_projected,
                      static_cast<unsigned long long>(__popc(drawn_lanes)));
  }
  first = __shfl_sync(renderer::cuda::kAllLanes, first, 0);
  sh.load(surfels.sh, drawn_lanes, id);
  if (drawn) {
    SurfelParameters<float> mine = surfels;
    mine.position_m += 3 * i;
    mine.sh = sh.row();
    mine.sh_degree = kDegree;
    // A degree that the compiler knows: the basis then stays in registers.
    with_known_degree<kDegree>(surfels.active_sh_degree, [&](auto active) {
      mine.active_sh_degree = decltype(active)::value;
      record.surfel.colour = colour_of(mine, 0, view.camera.pinhole);
    });
    view.visible[first + __popc(drawn_lanes & ((1U << renderer::cuda::lane_index()) - 1U))] =
        id;
    store(view, i, record, pixels);
    if (renderer::cuda::is_large(candidate))
      drawn = !renderer::cuda::put_aside(view.frame, 0, candidate, id);
  }
  renderer::cuda::emit<false>(view.frame, 0, candidate, drawn, id);
}

}  // namespace

void launch_project(const TrainingView& view, const SurfelParameters<float>& surfels,
                    cudaStream_t stream) {
  if (surfels.count == 0) return;
  const auto blocks = static_cast<unsigned>(
      (surfels.count + renderer::cuda::kProjectThreads - 1) / renderer::cuda::kProjectThreads);
  with_degree<3>(surfels.sh_degree, [&](auto stored) {
    project_surfels<decltype(stored)::value>
        <<<blocks, renderer::cuda::kProjectThreads, 0, stream>>>(view, surfels);
  });
  renderer::cuda::throw_on_error(cudaGetLastError(), "project_surfels");
  renderer::cuda::launch_bin_large<false>(view.frame, stream);
}

}  // namespace segsim::reconstruction::cuda
