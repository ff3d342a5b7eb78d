#include "renderer/reference_renderer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "renderer/internal/reference_resolve.h"
#include "renderer/internal/reference_surfels.h"
#include "renderer/scene/depth_normal.h"
#include "renderer/scene/projection_camera.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::has;
using internal::Meeting;
using internal::ReferenceSurfel;
using internal::ReferenceSurfels;

struct Pixel {
  double transmittance = 1.0;
  double depth = 0.0;  ///< Sum of weight * depth [m].
  double median_depth = 0.0;
  glm::dvec3 colour{0.0}, normal{0.0};
  std::vector<internal::ReferenceWeight> met;  ///< In the order of blending.
};

void allocate_images(const core::CameraIntrinsics& intrinsics, Channels channels,
                     bool has_features, core::Frame& frame) {
  const int w = intrinsics.width_px, h = intrinsics.height_px;
  frame.alpha = core::Image<float>(w, h);
  if (has(channels, Channels::kRgb)) frame.rgb = core::Image<core::Rgb8>(w, h);
  if (has(channels, Channels::kDepth) || has(channels, Channels::kDepthNormal)) {
    frame.depth_m = core::Image<float>(w, h);
  }
  if (has(channels, Channels::kNormal)) frame.normal = core::Image<glm::vec3>(w, h);
  if (has(channels, Channels::kLabels)) {
    frame.semantic = core::Image<std::uint16_t>(w, h);
    frame.instance = core::Image<std::uint16_t>(w, h);
    frame.confidence = core::Image<float>(w, h);
    frame.instance_confidence = core::Image<float>(w, h);
  }
  if (has(channels, Channels::kFeatures) && has_features) {
    frame.semantic_feature = core::Image<core::SemanticFeature>(w, h);
    frame.instance_feature = core::Image<core::InstanceFeature>(w, h);
  }
}

class ReferenceRenderer final : public core::Renderer {
 public:
  ReferenceRenderer(std::shared_ptr<const SurfelCloud> surfels, const RenderOptions& options)
      : surfels_(std::move(surfels)), options_(options) {}

  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              Channels channels, core::Frame& frame) override {
    const auto start = std::chrono::steady_clock::now();
    internal::check_intrinsics(intrinsics);
    frame = core::Frame{};
    frame.intrinsics = intrinsics;
    frame.T_world_camera = T_world_camera;
    allocate_images(intrinsics, channels, surfels_->has_features(), frame);
    const ReferenceSurfels surfels(*surfels_, options_, T_world_camera, intrinsics);
    frame.stats.surfels_projected = surfels.sorted().size();
    constexpr int kTile = internal::kCompatTilePx;
    for (int y = 0; y < intrinsics.height_px; y += kTile) {
      for (int x = 0; x < intrinsics.width_px; x += kTile) {
        render_tile(surfels, x, y, channels, frame);
      }
    }
    if (has(channels, Channels::kDepthNormal)) {
      frame.depth_normal = depth_normals(frame.depth_m, intrinsics, T_world_camera);
      if (!has(channels, Channels::kDepth)) frame.depth_m = {};
    }
    frame.stats.render_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count();
  }

 private:
  /// @param x0, y0  First pixel.
  void render_tile(const ReferenceSurfels& surfels, int x0, int y0, Channels channels,
                   core::Frame& frame) const {
    constexpr int kTile = internal::kCompatTilePx;
    std::vector<const ReferenceSurfel*> list;
    for (const ReferenceSurfel& s : surfels.sorted()) {
      if (surfels.listed(s, x0 / kTile, y0 / kTile)) list.push_back(&s);
    }
    if (surfels.lists_may_miss()) frame.stats.pairs_binned += list.size();
    for (int y = y0; y < std::min(y0 + kTile, frame.intrinsics.height_px); ++y) {
      for (int x = x0; x < std::min(x0 + kTile, frame.intrinsics.width_px); ++x) {
        write(blend(surfels, list, {x + 0.5, y + 0.5}, frame.stats), x, y, channels, frame);
      }
    }
  }

  [[nodiscard]] bool finishes(double left) const {
    return options_.compat == Compat::kExact
               ? left < static_cast<double>(kStopTransmittance)
               : internal::finishes(internal::rules_of(options_.compat), left);
  }

  [[nodiscard]] Pixel blend(const ReferenceSurfels& surfels,
                            const std::vector<const ReferenceSurfel*>& list,
                            const glm::dvec2& px, core::RenderStats& stats) const {
    Pixel pixel;
    for (const ReferenceSurfel* s : list) {
      const Meeting hit = surfels.meet(*s, px);
      if (hit.alpha == 0.0) continue;
      ++stats.evaluations;
      const double left = pixel.transmittance * (1.0 - hit.alpha);
      if (finishes(left)) break;
      ++stats.contributions;
      const double weight = pixel.transmittance * hit.alpha;
      if (pixel.transmittance > 1.0 - static_cast<double>(kMinSurfaceAlpha)) {
        pixel.median_depth = hit.depth_m;
      }
      pixel.transmittance = left;
      pixel.colour += weight * s->colour;
      pixel.normal += weight * s->normal_world;
      pixel.depth += weight * hit.depth_m;
      pixel.met.push_back({weight, s->index});
    }
    return pixel;
  }

  void write(Pixel pixel, int x, int y, Channels channels, core::Frame& frame) const {
    const double alpha = 1.0 - pixel.transmittance;
    const bool surface = alpha >= static_cast<double>(kMinSurfaceAlpha);
    frame.alpha(x, y) = static_cast<float>(alpha);
    if (has(channels, Channels::kRgb)) {
      const auto byte = [](double value) {
        return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(value, 0.0, 1.0)));
      };
      frame.rgb(x, y) = {byte(pixel.colour.r), byte(pixel.colour.g), byte(pixel.colour.b)};
    }
    if (!frame.depth_m.empty()) {
      const double depth_m =
          options_.depth == DepthMode::kMedian ? pixel.median_depth : pixel.depth / alpha;
      frame.depth_m(x, y) =
          surface ? static_cast<float>(depth_m) : std::numeric_limits<float>::quiet_NaN();
    }
    if (has(channels, Channels::kNormal)) {
      const double length = glm::length(pixel.normal);
      frame.normal(x, y) =
          surface && length > 0.0 ? glm::vec3(pixel.normal / length) : glm::vec3(0.0F);
    }
    if (!surface) return;
    const auto selected = internal::select_top_k(std::move(pixel.met), options_);
    if (has(channels, Channels::kLabels) && surfels_->has_labels()) {
      internal::write_reference_labels(*surfels_, selected, x, y, frame);
    }
    if (has(channels, Channels::kFeatures) && surfels_->has_features()) {
      internal::write_reference_features(*surfels_, selected, x, y, frame);
    }
  }

  std::shared_ptr<const SurfelCloud> surfels_;
  RenderOptions options_;
};

}  // namespace

std::unique_ptr<core::Renderer> make_reference_renderer(
    std::shared_ptr<const SurfelCloud> surfels, RenderOptions options) {
  SEGSIM_CHECK(surfels != nullptr, "no scene");
  check_surfels(*surfels);
  check_render_options(options);
  return std::make_unique<ReferenceRenderer>(std::move(surfels), options);
}

}  // namespace segsim::renderer
