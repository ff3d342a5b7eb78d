#include "renderer/cpu_renderer.h"

#include <atomic>
#include <chrono>
#include <utility>

#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "renderer/internal/packed_surfels.h"
#include "renderer/internal/parallel.h"
#include "renderer/internal/projection.h"
#include "renderer/internal/projection_camera.h"
#include "renderer/internal/tile_binning.h"
#include "renderer/internal/tile_raster.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::has;

template <class Pixel>
void resize_if(bool wanted, const core::CameraIntrinsics& intrinsics,
               core::Image<Pixel>& image) {
  // An image that is not wanted becomes empty but keeps its memory.
  image.resize(wanted ? intrinsics.width_px : 0, wanted ? intrinsics.height_px : 0);
}

void resize_images(const core::CameraIntrinsics& intrinsics, Channels channels,
                   core::Frame& frame) {
  resize_if(has(channels, Channels::kRgb), intrinsics, frame.rgb);
  resize_if(has(channels, Channels::kDepth), intrinsics, frame.depth_m);
  resize_if(has(channels, Channels::kNormal), intrinsics, frame.normal);
  resize_if(true, intrinsics, frame.alpha);
  resize_if(has(channels, Channels::kLabels), intrinsics, frame.semantic);
  resize_if(has(channels, Channels::kLabels), intrinsics, frame.instance);
  resize_if(has(channels, Channels::kLabels), intrinsics, frame.confidence);
}

class CpuRenderer final : public core::Renderer {
 public:
  CpuRenderer(std::shared_ptr<const SurfelCloud> surfels, const RenderOptions& options)
      : surfels_(std::move(surfels)),
        options_(options),
        packed_(*surfels_),
        workers_(options.threads) {}

  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              Channels channels, core::Frame& frame) override {
    const auto start = std::chrono::steady_clock::now();
    internal::check_intrinsics(intrinsics);
    frame.intrinsics = intrinsics;
    frame.T_world_camera = T_world_camera;
    resize_images(intrinsics, channels, frame);

    const internal::ProjectionJob projection{
        *surfels_,
        packed_,
        internal::projection_camera<float>(T_world_camera, intrinsics),
        intrinsics.width_px,
        intrinsics.height_px,
        options_.near_m,
        has(channels, Channels::kRgb)};
    internal::project_surfels(projection, workers_, projected_);
    bins_.build(projected_, intrinsics.width_px, intrinsics.height_px, workers_);
    raster(channels, frame);

    frame.stats.surfels_projected = bins_.surfel_count();
    frame.stats.pairs_binned = bins_.pair_count();
    frame.stats.render_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count();
  }

 private:
  void raster(Channels channels, core::Frame& frame) {
    const internal::RasterJob job{projected_,
                                  bins_,
                                  frame,
                                  channels,
                                  options_.top_k,
                                  options_.depth == DepthMode::kMedian,
                                  surfels_->has_labels()};
    std::atomic<std::uint64_t> touched{0}, evaluations{0}, contributions{0};
    const std::size_t tile_count =
        static_cast<std::size_t>(bins_.tiles_x()) * static_cast<std::size_t>(bins_.tiles_y());
    workers_.for_each(tile_count, [&](std::size_t tile) {
      const internal::TileStats stats = internal::raster_tile(job, tile);
      touched.fetch_add(stats.pairs_touched, std::memory_order_relaxed);
      evaluations.fetch_add(stats.evaluations, std::memory_order_relaxed);
      contributions.fetch_add(stats.contributions, std::memory_order_relaxed);
    });
    frame.stats = {};
    frame.stats.pairs_touched = touched;
    frame.stats.evaluations = evaluations;
    frame.stats.contributions = contributions;
  }

  std::shared_ptr<const SurfelCloud> surfels_;
  RenderOptions options_;
  internal::PackedSurfels packed_;
  internal::Workers workers_;
  internal::ProjectedSurfels projected_;
  internal::TileBins bins_;
};

}  // namespace

std::unique_ptr<core::Renderer> make_cpu_renderer(std::shared_ptr<const SurfelCloud> surfels,
                                                  RenderOptions options) {
  SEGSIM_CHECK(surfels != nullptr, "no scene");
  check_surfels(*surfels);
  check_render_options(options);
  return std::make_unique<CpuRenderer>(std::move(surfels), options);
}

}  // namespace segsim::renderer
