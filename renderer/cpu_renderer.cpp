#include "renderer/cpu_renderer.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <utility>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "renderer/raster/compat_projection.h"
#include "renderer/raster/compat_rules.h"
#include "renderer/raster/field_vote.h"
#include "renderer/raster/label_resolve.h"
#include "renderer/raster/projection.h"
#include "renderer/raster/tile_binning.h"
#include "renderer/raster/tile_raster.h"
#include "renderer/scene/depth_normal.h"
#include "renderer/scene/packed_surfels.h"
#include "renderer/scene/parallel.h"
#include "renderer/scene/projection_camera.h"

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

/// @param channels  With depth where depth normals are wanted.
void resize_images(const core::CameraIntrinsics& intrinsics, Channels channels,
                   core::Frame& frame) {
  resize_if(has(channels, Channels::kRgb), intrinsics, frame.rgb);
  resize_if(has(channels, Channels::kDepth), intrinsics, frame.depth_m);
  resize_if(has(channels, Channels::kNormal), intrinsics, frame.normal);
  resize_if(true, intrinsics, frame.alpha);
  resize_if(has(channels, Channels::kLabels), intrinsics, frame.semantic);
  resize_if(has(channels, Channels::kLabels), intrinsics, frame.instance);
  resize_if(has(channels, Channels::kLabels), intrinsics, frame.confidence);
  resize_if(has(channels, Channels::kLabels), intrinsics, frame.instance_confidence);
  const bool features = has(channels, Channels::kFeatures);
  resize_if(features, intrinsics, frame.semantic_feature);
  resize_if(features, intrinsics, frame.instance_feature);
  resize_if(has(channels, Channels::kDepthNormal), intrinsics, frame.depth_normal);
}

class CpuRenderer final : public core::Renderer {
 public:
  CpuRenderer(std::shared_ptr<const SurfelCloud> surfels, const RenderOptions& options,
              std::shared_ptr<const PanopticField> field)
      : surfels_(std::move(surfels)),
        field_(std::move(field)),
        options_(options),
        tops_(field_ != nullptr ? internal::FieldTops(*field_) : internal::FieldTops()),
        packed_(*surfels_, tops_.labels()),
        workers_(options.threads) {}

  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              Channels channels, core::Frame& frame) override {
    const auto start = std::chrono::steady_clock::now();
    internal::check_intrinsics(intrinsics);
    frame.intrinsics = intrinsics;
    frame.T_world_camera = T_world_camera;
    const bool depth_normals = has(channels, Channels::kDepthNormal);
    const Channels drawn = depth_normals ? channels | Channels::kDepth : channels;
    resize_images(intrinsics, drawn, frame);

    const internal::ProjectionJob projection{
        *surfels_,
        packed_,
        internal::projection_camera<float>(T_world_camera, intrinsics),
        intrinsics.width_px,
        intrinsics.height_px,
        options_.near_m,
        has(channels, Channels::kRgb),
        options_.bounds};
    frame.stats = {};
    draw(projection, drawn, frame);
    if (depth_normals) find_depth_normals(frame);
    if (drawn != channels) frame.depth_m.resize(0, 0);
    frame.stats.render_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count();
  }

 private:
  struct LiveTile {
    std::uint32_t work;  ///< Entries that wait for it.
    std::uint32_t tile;
  };

  /// Nearest clusters first, a slab at a time, until every pixel is finished: what lies behind
  /// is neither projected nor binned.
  void draw(const internal::ProjectionJob& projection, Channels channels, core::Frame& frame) {
    bins_.begin(projection.width_px, projection.height_px, workers_.thread_count());
    if (progress_.size() < bins_.tile_count()) progress_.resize(bins_.tile_count());
    for (internal::TileProgress& tile : progress_) tile.started = false;
    const bool exact = options_.compat == Compat::kExact;
    if (exact) {
      internal::find_visible_clusters(projection, projected_);
    } else {
      internal::find_clusters_compat(projection, projected_);
    }
    const std::size_t total = projected_.visible.size();
    const std::size_t slab = slab_size(total);
    std::size_t begin = 0;
    do {
      const std::size_t end = std::min(total, begin + slab);
      const float bound_m = end == total ? std::numeric_limits<float>::infinity()
                                         : projected_.visible[end].nearest_m;
      bins_.open_slab();
      if (exact) {
        internal::project_clusters(projection, begin, end, workers_, projected_, bins_);
      } else {
        internal::project_clusters_compat(projection, options_.compat, begin, end, workers_,
                                          projected_, bins_);
      }
      bins_.close_slab();
      for (std::size_t v = begin; v < end; ++v) {
        frame.stats.surfels_projected += projected_.count[v];
      }
      raster(channels, bound_m, end == total, frame);
      begin = end;
    } while (begin < total && !live_.empty());
    frame.stats.pairs_binned = bins_.pair_count();
  }

  void find_depth_normals(core::Frame& frame) {
    constexpr int kRowsPerTask = 16;
    const int height = frame.intrinsics.height_px;
    const auto tasks = static_cast<std::size_t>((height + kRowsPerTask - 1) / kRowsPerTask);
    workers_.for_each(tasks, [&](std::size_t task) {
      const int y = static_cast<int>(task) * kRowsPerTask;
      depth_normal_rows(frame.depth_m, frame.intrinsics, frame.T_world_camera, y,
                        std::min(height, y + kRowsPerTask), frame.depth_normal);
    });
  }

  /// Clusters of a slab; a multiple of kClustersPerTask.
  [[nodiscard]] std::size_t slab_size(std::size_t visible) const {
    // What is kept of all surfels of a pixel, and the pixels of very large images, do not wait
    // from one slab to the next.
    constexpr std::size_t kMaxTiles = 65536;
    if (!options_.skip_hidden || options_.top_k == kAllSurfels ||
        bins_.tile_count() > kMaxTiles) {
      return visible + 1;
    }
    constexpr std::size_t kLeast = 16 * internal::kClustersPerTask;
    constexpr std::size_t kSlabs = 5;
    const std::size_t size = std::max(kLeast, visible / kSlabs + 1);
    return (size + internal::kClustersPerTask - 1) / internal::kClustersPerTask *
           internal::kClustersPerTask;
  }

  /// Live tiles, those with the most to do first. Those with little to do only collect their
  /// entries.
  void raster(Channels channels, float bound_m, bool last, core::Frame& frame) {
    const internal::ResolveJob resolve{
        surfels_.get(),         field_.get(),   field_ != nullptr ? &tops_ : nullptr,
        surfels_->has_labels(), options_.top_k, options_.top_k_rule};
    const internal::RasterJob job{.projected = projected_,
                                  .bins = bins_,
                                  .frame = frame,
                                  .channels = channels,
                                  .top_k = options_.top_k,
                                  .median_depth = options_.depth == DepthMode::kMedian,
                                  .labelled = surfels_->has_labels(),
                                  .resolve = &resolve,
                                  .selects = internal::wants_candidates(resolve, channels),
                                  .wants_depth = has(channels, Channels::kDepth),
                                  .first_hits = options_.top_k_rule == TopKRule::kFirst,
                                  .all_surfels = options_.top_k == kAllSurfels,
                                  .logs_labels = internal::wants_labels(resolve, channels),
                                  .sums_features = internal::wants_features(resolve, channels),
                                  .labels_only = channels == Channels::kLabels,
                                  .stop_transmittance = options_.compat == Compat::kExact
                                                            ? kStopTransmittance
                                                            : internal::kCompatStopInFloat};
    find_live_tiles();
    std::atomic<std::uint64_t> touched{0}, evaluations{0}, contributions{0}, fetches{0};
    workers_.for_each(live_.size(), [&](std::size_t i) {
      const auto [work, tile] = live_[i];
      bins_.collect(tile);
      // Fewer entries rarely saturate a tile, and its pixels would have to be put aside.
      constexpr std::uint32_t kWorthwhile = 160;
      if (!last && work < kWorthwhile) return;
      bins_.extend_list(tile, bound_m, projected_.shade.data());
      const internal::TileStats stats =
          internal::raster_tile(job, tile, last, progress_[tile]);
      if (stats.finished) bins_.retire(tile);
      touched.fetch_add(stats.pairs_touched, std::memory_order_relaxed);
      evaluations.fetch_add(stats.evaluations, std::memory_order_relaxed);
      contributions.fetch_add(stats.contributions, std::memory_order_relaxed);
      fetches.fetch_add(stats.feature_fetches, std::memory_order_relaxed);
    });
    frame.stats.pairs_touched += touched;
    frame.stats.evaluations += evaluations;
    frame.stats.contributions += contributions;
    frame.stats.feature_fetches += fetches;
    std::erase_if(live_, [&](const LiveTile& tile) { return !bins_.is_live(tile.tile); });
  }

  void find_live_tiles() {
    live_.clear();
    for (std::size_t tile = 0; tile < bins_.tile_count(); ++tile) {
      if (!bins_.is_live(tile)) continue;
      live_.push_back(
          {static_cast<std::uint32_t>(bins_.waiting(tile)), static_cast<std::uint32_t>(tile)});
    }
    std::sort(live_.begin(), live_.end(), [](const LiveTile& a, const LiveTile& b) {
      return a.work != b.work ? a.work > b.work : a.tile < b.tile;
    });
  }

  std::shared_ptr<const SurfelCloud> surfels_;
  std::shared_ptr<const PanopticField> field_;  ///< May be null.
  RenderOptions options_;
  internal::FieldTops tops_;  ///< Of the field; empty without one.
  internal::PackedSurfels packed_;
  internal::Workers workers_;
  internal::ProjectedSurfels projected_;
  internal::TileBins bins_;
  std::vector<internal::TileProgress> progress_;
  std::vector<LiveTile> live_;
};

}  // namespace

std::unique_ptr<core::Renderer> make_cpu_renderer(std::shared_ptr<const SurfelCloud> surfels,
                                                  RenderOptions options,
                                                  std::shared_ptr<const PanopticField> field) {
  SEGSIM_CHECK(surfels != nullptr, "no scene");
  check_surfels(*surfels);
  check_render_options(options);
  SEGSIM_CHECK(field == nullptr || field->size() == surfels->size(), "field of another scene");
  return std::make_unique<CpuRenderer>(std::move(surfels), options, std::move(field));
}

}  // namespace segsim::renderer
