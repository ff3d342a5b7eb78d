#pragma once

/// @file
/// The stages of one view by themselves, on one thread and in one slab: what stands between
/// the renderer's internal headers and the tests and benchmarks that look into it.

#include <bit>
#include <cstdint>
#include <limits>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"
#include "core/render.h"
#include "renderer/raster/label_resolve.h"
#include "renderer/raster/projection.h"
#include "renderer/raster/tile_binning.h"
#include "renderer/raster/tile_raster.h"
#include "renderer/scene/packed_surfels.h"
#include "renderer/scene/parallel.h"
#include "renderer/scene/projection_camera.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer::testing {

/// (surfel, tile) pairs of a view.
using Pairs = std::set<std::pair<std::uint32_t, std::size_t>>;

class ViewStages {
 public:
  ViewStages(std::shared_ptr<const SurfelCloud> cloud, const core::CameraPose& pose,
             const core::CameraIntrinsics& camera, const RenderOptions& options = {})
      : cloud_(std::move(cloud)),
        packed_(*cloud_),
        camera_(camera),
        options_(options),
        job_{*cloud_,
             packed_,
             internal::projection_camera<float>(pose, camera),
             camera.width_px,
             camera.height_px,
             options.near_m,
             /*colours=*/true,
             options.bounds} {
    frame_.intrinsics = camera;
    frame_.T_world_camera = pose;
  }

  /// Finds, projects and bins.
  void project() {
    internal::find_visible_clusters(job_, projected);
    bins.begin(camera_.width_px, camera_.height_px, 1);
    bins.open_slab();
    internal::project_clusters(job_, 0, projected.visible.size(), workers_, projected, bins);
    bins.close_slab();
  }
  /// The same with no tile that wants anything.
  void project_only() {
    internal::find_visible_clusters(job_, projected);
    bins.begin(camera_.width_px, camera_.height_px, 1);
    for (std::size_t tile = 0; tile < bins.tile_count(); ++tile) bins.retire(tile);
    bins.open_slab();
    internal::project_clusters(job_, 0, projected.visible.size(), workers_, projected, bins);
    bins.close_slab();
  }
  /// Enters every projected surfel in every tile instead. After project().
  void bin_everything_everywhere() {
    bins.begin(camera_.width_px, camera_.height_px, 1);
    bins.open_slab();
    for_each_slot([&](std::uint32_t slot) {
      const auto depth = static_cast<internal::DepthSlot>(depth_bits(slot));
      for (int y = 0; y < tiles_y(); ++y) {
        bins.writer(0).add_row(y, 0, bins.tiles_x(), depth << 32U | slot);
      }
      internal::ScreenSurfel& s = projected.screen[slot];
      s.x_lo = s.y_lo = 0;
      s.x_hi = static_cast<std::uint16_t>(camera_.width_px - 1);
      s.y_hi = static_cast<std::uint16_t>(camera_.height_px - 1);
    });
    bins.close_slab();
  }
  /// Brings the tiles' lists in order. After project(), once.
  void list() {
    for (std::size_t tile = 0; tile < bins.tile_count(); ++tile) {
      bins.collect(tile);
      bins.extend_list(tile, std::numeric_limits<float>::infinity(), projected.shade.data());
    }
  }
  /// Blends all tiles and writes `channels` of them. After list().
  internal::TileStats raster(core::Channels channels) {
    allocate(channels);
    const internal::ResolveJob resolve{.cloud = cloud_.get(),
                                       .labelled = cloud_->has_labels(),
                                       .top_k = options_.top_k,
                                       .rule = options_.top_k_rule};
    const internal::RasterJob job{.projected = projected,
                                  .bins = bins,
                                  .frame = frame_,
                                  .channels = channels,
                                  .top_k = options_.top_k,
                                  .median_depth = options_.depth == DepthMode::kMedian,
                                  .labelled = cloud_->has_labels(),
                                  .resolve = &resolve,
                                  .selects = internal::wants_candidates(resolve, channels),
                                  .wants_depth = core::has(channels, core::Channels::kDepth),
                                  .first_hits = options_.top_k_rule == TopKRule::kFirst,
                                  .all_surfels = options_.top_k == kAllSurfels};
    progress_.resize(bins.tile_count());
    internal::TileStats sum;
    for (std::size_t tile = 0; tile < bins.tile_count(); ++tile) {
      progress_[tile].started = false;
      const auto stats = internal::raster_tile(job, tile, true, progress_[tile]);
      sum.pairs_touched += stats.pairs_touched;
      sum.evaluations += stats.evaluations;
      sum.contributions += stats.contributions;
      sum.feature_fetches += stats.feature_fetches;
    }
    return sum;
  }

  /// Pairs of the lists.
  [[nodiscard]] Pairs pairs() const {
    Pairs pairs;
    for (std::size_t tile = 0; tile < bins.tile_count(); ++tile) {
      for (const std::uint32_t slot : bins.list(tile)) {
        pairs.emplace(projected.shade[slot].surfel, tile);
      }
    }
    return pairs;
  }
  [[nodiscard]] std::size_t surfel_count() const {
    std::size_t count = 0;
    for_each_slot([&](std::uint32_t) { ++count; });
    return count;
  }
  [[nodiscard]] const core::Frame& frame() const { return frame_; }

  internal::ProjectedSurfels projected;
  internal::TileBins bins;

 private:
  [[nodiscard]] int tiles_y() const {
    return (camera_.height_px + internal::kTileSizePx - 1) / internal::kTileSizePx;
  }
  [[nodiscard]] std::uint32_t depth_bits(std::uint32_t slot) const {
    return std::bit_cast<std::uint32_t>(projected.screen[slot].z0_m);
  }
  template <class Body>
  void for_each_slot(const Body& body) const {
    for (std::size_t v = 0; v < projected.visible.size(); ++v) {
      for (std::uint32_t i = 0; i < projected.count[v]; ++i) {
        body(static_cast<std::uint32_t>(v * internal::kClusterSize + i));
      }
    }
  }
  void allocate(core::Channels channels) {
    const int w = camera_.width_px, h = camera_.height_px;
    frame_.alpha.resize(w, h);
    if (core::has(channels, core::Channels::kRgb)) frame_.rgb.resize(w, h);
    if (core::has(channels, core::Channels::kDepth)) frame_.depth_m.resize(w, h);
    if (core::has(channels, core::Channels::kNormal)) frame_.normal.resize(w, h);
    if (!core::has(channels, core::Channels::kLabels)) return;
    frame_.semantic.resize(w, h);
    frame_.instance.resize(w, h);
    frame_.confidence.resize(w, h);
    frame_.instance_confidence.resize(w, h);
  }

  std::shared_ptr<const SurfelCloud> cloud_;
  internal::PackedSurfels packed_;
  internal::Workers workers_{1};
  core::CameraIntrinsics camera_;
  RenderOptions options_;
  internal::ProjectionJob job_;
  core::Frame frame_;
  std::vector<internal::TileProgress> progress_;
};

}  // namespace segsim::renderer::testing
