/// @file
/// From the scene to the tiles' lists. One lane looks at one surfel; what a warp found is then
/// spread evenly over its lanes: first tile rows, then tiles. Compiled without contraction of
/// a * b + c, so that the order of surfels is that of the CPU's renderers.

#include <cuda_fp16.h>

#include "renderer/cuda/kernels.h"
#include "renderer/cuda/large_surfels.cuh"
#include "renderer/cuda/screen_tiles.cuh"
#include "renderer/cuda/tile_spans.cuh"
#include "renderer/cuda/warp.cuh"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::cuda {
namespace {

constexpr float kHalfLog2E = 0.72134752F;

__device__ int limited(float tile, int tiles) {
  return tile > 0.0F ? static_cast<int>(fminf(tile, static_cast<float>(tiles))) : 0;
}

/// As the 2DGS code lists its square: tiles_of_square() of internal/compat_rules.h.
__device__ bool find_square_tiles(const FrameView& frame, const ScreenBox<float>& box,
                                  Candidate& out) {
  const auto first = [](float px) { return (px - 0.5F) / kTilePx; };
  const auto end = [](float px) { return (px - 0.5F + (kTilePx - 1)) / kTilePx; };
  out.x_begin = limited(first(box.x_min_px), frame.tiles_x);
  out.x_end = limited(end(box.x_max_px), frame.tiles_x);
  out.y_begin = limited(first(box.y_min_px), frame.tiles_y);
  out.y_end = limited(end(box.y_max_px), frame.tiles_y);
  return out.x_begin < out.x_end && out.y_begin < out.y_end;
}

__device__ Vec3<float> colour_of(const SceneView& scene, const Vec3<float>& eye_m, int m) {
  if (scene.sh == nullptr) return {scene.red[m], scene.green[m], scene.blue[m]};
  Vec3<float> ray{scene.x_m[m] - eye_m.x, scene.y_m[m] - eye_m.y, scene.z_m[m] - eye_m.z};
  const float scale = 1.0F / sqrtf(dot(ray, ray));
  ray = {ray.x * scale, ray.y * scale, ray.z * scale};
  float basis[16];
  sh_basis(scene.sh_degree, ray, basis);
  const int count = (scene.sh_degree + 1) * (scene.sh_degree + 1);
  const float* sh = scene.sh + static_cast<std::size_t>(m) * 3 * count;
  Vec3<float> sum{0.5F, 0.5F, 0.5F};
  for (int k = 0; k < count; ++k) {
    sum.x += basis[k] * sh[3 * k];
    sum.y += basis[k] * sh[3 * k + 1];
    sum.z += basis[k] * sh[3 * k + 2];
  }
  return {fmaxf(sum.x, 0.0F), fmaxf(sum.y, 0.0F), fmaxf(sum.z, 0.0F)};
}

__device__ std::uint32_t halves(float a, float b) {
  // Beyond the range of a half: no display shows that.
  const __half2 pair = __floats2half2_rn(fminf(a, 65504.0F), fminf(b, 65504.0F));
  return *reinterpret_cast<const std::uint32_t*>(&pair);
}

__device__ void shade(const FrameView& frame, const SceneView& scene,
                      const ProjectionCamera<float>& camera, int m, SurfelRecord& record) {
  Vec3<float> colour{0.0F, 0.0F, 0.0F}, n{0.0F, 0.0F, 0.0F};
  if (frame.colours) colour = colour_of(scene, camera.centre_m, m);
  if (frame.normals) {
    n = {scene.nx[m], scene.ny[m], scene.nz[m]};
    const Vec3<float> ray{scene.x_m[m] - camera.centre_m.x, scene.y_m[m] - camera.centre_m.y,
                          scene.z_m[m] - camera.centre_m.z};
    if (dot(n, ray) > 0.0F) n = {-n.x, -n.y, -n.z};
  }
  record.rg = halves(colour.x, colour.y);
  record.b_nx = halves(colour.z, n.x);
  record.ny_nz = halves(n.y, n.z);
}

/// @return  False if the surfel reaches no pixel.
__device__ bool project(const FrameView& frame, const SceneView& scene,
                        const ProjectionCamera<float>& camera, int m, Candidate& out,
                        SurfelRecord& record) {
  const float k2 = scene.k2[m];
  const Vec3<float> position{scene.x_m[m], scene.y_m[m], scene.z_m[m]};
  out.z0_m = depth_of_centre(camera, position);
  if (!(out.z0_m > frame.near_m) || !(k2 > 0.0F)) return false;
  const auto s =
      project_surfel<float>(camera, position, {scene.ux_m[m], scene.uy_m[m], scene.uz_m[m]},
                            {scene.vx_m[m], scene.vy_m[m], scene.vz_m[m]});
  const bool clipped = crosses_near_plane(s, k2 * kBoundSlack, frame.near_m);
  const ScreenBox<float> box = bound_on_screen(s, k2, frame.near_m, clipped, out.outline);
  out.rule =
      clipped || frame.bounds == BoundsRule::kSnugBox ? TilesRule::kAll : TilesRule::kQuarters;
  bool reached;
  if (frame.bounds == BoundsRule::kAabb) {
    out.rule = TilesRule::kAll;
    reached = find_square_tiles(frame, aabb_3_sigma(s), out);
  } else if (frame.bounds == BoundsRule::kPaper) {
    out.outline = paper_outline(s, k2);
    out.rule = TilesRule::kRows;
    reached = find_tiles(frame, with_low_pass(box_of(out.outline), s, k2), out);
  } else {
    reached = find_tiles(frame, box, out);
  }
  if (!reached) return false;
  out.x0_px = s.x0_px, out.y0_px = s.y0_px;
  out.low_pass_radius2 = 0.5F * (k2 * kBoundSlack);

  const float root = 0.84932180F;  // sqrt(kHalfLog2E)
  const InverseDepthRange<float> range = inverse_depth_range(s, k2, frame.near_m);
  record.x0_px = s.x0_px, record.y0_px = s.y0_px;
  record.m00 = root * s.m00, record.m01 = root * s.m01;
  record.m10 = root * s.m10, record.m11 = root * s.m11;
  record.g0 = s.g0, record.g1 = s.g1;
  record.c_k2 = kHalfLog2E * k2;
  record.z0_m = s.z0_m;
  record.e_min = range.e_min / kBoundSlack, record.e_max = range.e_max * kBoundSlack;
  record.flags =
      (clipped ? kCare : 0U) | (clipped || s.edge_on || low_pass_matters(s, k2) ? kThin : 0U);
  return true;
}

/// Can a surfel of the cluster be on the list of some tile? The whole warp asks.
template <bool kRedo>
__device__ bool cluster_wanted(const FrameView& frame, const ProjectionCamera<float>& c,
                               const float4& cluster, int camera) {
  if (!kRedo && !frame.culls) return true;
  const float r = cluster.w;
  const Vec3<float> offset{cluster.x - c.centre_m.x, cluster.y - c.centre_m.y,
                           cluster.z - c.centre_m.z};
  const float z = dot(c.forward, offset);
  const float nearest_m = z - r * kBoundSlack - 1e-4F * fabsf(z);
  const float farthest_m = z + r * kBoundSlack + 1e-4F * fabsf(z);
  if (!(nearest_m > frame.near_m)) return true;
  // Box of the projections of the box about the sphere.
  const auto extreme = [&](float along, float f_px, float c_px, float side) {
    const float edge = along + side * r;
    const float at = side * edge > 0.0F ? edge / nearest_m : edge / farthest_m;
    return f_px * at + c_px + side * (kFrustumMarginPx + 1e-4F * fabsf(f_px * at));
  };
  const float x = dot(c.right, offset), y = dot(c.down, offset);
  const auto tile_of = [](float px, int tiles) {
    return static_cast<int>(fminf(fmaxf(px / kTilePx, 0.0F), static_cast<float>(tiles - 1)));
  };
  const int x_begin = tile_of(extreme(x, c.fx_px, c.cx_px, -1.0F), frame.tiles_x);
  const int x_last = tile_of(extreme(x, c.fx_px, c.cx_px, 1.0F), frame.tiles_x);
  const int y_begin = tile_of(extreme(y, c.fy_px, c.cy_px, -1.0F), frame.tiles_y);
  const int y_last = tile_of(extreme(y, c.fy_px, c.cy_px, 1.0F), frame.tiles_y);
  const int width = x_last - x_begin + 1, count = width * (y_last - y_begin + 1);
  const int first = first_tile_of(frame, camera);
  if constexpr (kRedo) {
    const int redone = static_cast<int>(frame.queue[2]);
    for (int base = 0; base < redone; base += kWarp) {
      const int at = base + lane_index();
      bool wanted = false;
      if (at < redone) {
        const int tile = static_cast<int>(frame.redo_list[at]);
        const int local = tile - first;
        const int tx = local % frame.tiles_x, ty = local / frame.tiles_x;
        wanted = tile >= first && tx >= x_begin && tx <= x_last && ty >= y_begin &&
                 ty <= y_last && frame.bound_m[tile] < farthest_m;
      }
      if (__any_sync(kAllLanes, wanted)) return true;
    }
    return false;
  }
  constexpr int kTooMany = 512;  // Then projecting costs no more than asking.
  if (count > kTooMany) return true;
  for (int base = 0; base < count; base += kWarp) {
    const int t = base + lane_index();
    bool wanted = false;
    if (t < count) {
      const int tile = first + (y_begin + t / width) * frame.tiles_x + x_begin + t % width;
      wanted = frame.bound_m[tile] >= nearest_m;
    }
    if (__any_sync(kAllLanes, wanted)) return true;
  }
  return false;
}

/// A warp takes half a cluster for one camera.
template <bool kRedo>
__global__ void __launch_bounds__(kProjectThreads)
    project_and_bin(FrameView frame, SceneView scene) {
  if (kRedo && frame.queue[2] == 0) return;
  const int warp = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x) / kWarp;
  const int m = warp * kWarp + lane_index();
  const int camera_index = static_cast<int>(blockIdx.y);
  if (m >= scene.clusters * kClusterSurfels) return;
  const float4 cluster = reinterpret_cast<const float4*>(scene.cluster)[m / kClusterSurfels];
  if (!sphere_in_view(frame.near_m, frame.camera[camera_index], cluster)) return;
  const ProjectionCamera<float> camera = frame.camera[camera_index].pinhole;
  if (!cluster_wanted<kRedo>(frame, camera, cluster, camera_index)) return;
  Candidate candidate{};
  SurfelRecord record{};
  bool drawn = project(frame, scene, camera, m, candidate, record);
  const unsigned drawn_lanes = __ballot_sync(kAllLanes, drawn);
  if (drawn_lanes == 0) return;
  const std::uint32_t id = scene.id[m];
  if (drawn) {
    shade(frame, scene, camera, m, record);
    const std::size_t place =
        static_cast<std::size_t>(camera_index) * scene.clusters * kClusterSurfels + m;
    frame.record[place] = record;
    if (is_large(candidate)) drawn = !put_aside(frame, camera_index, candidate, id);
  }
  if (!kRedo && lane_index() == 0) {
    atomicAdd(&frame.status->surfels_projected,
              static_cast<unsigned long long>(__popc(drawn_lanes)));
  }
  emit<kRedo>(frame, camera_index, candidate, drawn, id);
}

template <bool kRedo>
void launch_project(const FrameView& frame, const SceneView& scene, cudaStream_t stream) {
  const int warps = scene.clusters * (kClusterSurfels / kWarp);
  constexpr int kWarps = kProjectThreads / kWarp;
  if (warps == 0) return;
  const dim3 grid(static_cast<unsigned>((warps + kWarps - 1) / kWarps),
                  static_cast<unsigned>(frame.cameras));
  project_and_bin<kRedo><<<grid, kProjectThreads, 0, stream>>>(frame, scene);
  throw_on_error(cudaGetLastError(), "project_and_bin");
  launch_bin_large<kRedo>(frame, stream);
}

}  // namespace

void launch_project_and_bin(const FrameView& frame, const SceneView& scene, bool redo,
                            cudaStream_t stream) {
  if (redo) {
    launch_project<true>(frame, scene, stream);
  } else {
    launch_project<false>(frame, scene, stream);
  }
}

}  // namespace segsim::renderer::cuda
