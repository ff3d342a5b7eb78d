#include "renderer/reference_renderer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "renderer/internal/projection_camera.h"
#include "renderer/surfel_geometry.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::has;

/// A surfel in the camera frame.
struct CameraSurfel {
  std::size_t index;
  float depth_key;
  glm::dvec3 centre_m, u_m, v_m;  ///< u, v: tangents times scales.
  glm::dvec3 normal_world;        ///< Towards the camera.
  glm::dvec3 colour;
  double opacity, k2;
  glm::dvec2 centre_px;
  double z_min_m, z_max_m;  ///< Depth range of the visible disc.
  bool edge_on;
};

struct Contribution {
  double alpha, depth_m;
};

struct Pixel {
  double transmittance = 1.0;
  double depth = 0.0;  ///< Sum of weight * depth [m].
  double median_depth = 0.0;
  glm::dvec3 colour{0.0}, normal{0.0};
  std::vector<std::pair<double, std::size_t>> weights;  ///< (weight, surfel)
};

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
    const int w = intrinsics.width_px, h = intrinsics.height_px;
    frame.alpha = core::Image<float>(w, h);
    if (has(channels, Channels::kRgb)) frame.rgb = core::Image<core::Rgb8>(w, h);
    if (has(channels, Channels::kDepth)) frame.depth_m = core::Image<float>(w, h);
    if (has(channels, Channels::kNormal)) frame.normal = core::Image<glm::vec3>(w, h);
    if (has(channels, Channels::kLabels)) {
      frame.semantic = core::Image<std::uint16_t>(w, h);
      frame.instance = core::Image<std::uint16_t>(w, h);
      frame.confidence = core::Image<float>(w, h);
    }
    const std::vector<CameraSurfel> sorted = sorted_surfels(T_world_camera, intrinsics);
    frame.stats.surfels_projected = sorted.size();
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        write(blend(sorted, intrinsics, {x + 0.5, y + 0.5}, frame.stats), x, y, channels,
              frame);
      }
    }
    frame.stats.render_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count();
  }

 private:
  [[nodiscard]] glm::dvec3 colour_of(std::size_t i, const glm::dvec3& eye_m) const {
    const glm::dvec3 direction = glm::normalize(glm::dvec3(surfels_->position_m[i]) - eye_m);
    double basis[16];
    sh_basis(surfels_->sh_degree, Vec3<double>{direction.x, direction.y, direction.z}, basis);
    glm::dvec3 sum(0.5);
    for (std::size_t k = 0; k < surfels_->sh_count(); ++k) {
      sum += basis[k] * glm::dvec3(surfels_->sh[i * surfels_->sh_count() + k]);
    }
    return glm::max(sum, glm::dvec3(0.0));
  }

  [[nodiscard]] CameraSurfel in_camera(std::size_t i, const core::CameraPose& T_world_camera,
                                       const core::CameraIntrinsics& intrinsics) const {
    const core::Transform<core::frame::Camera, core::frame::World> T_camera_world =
        T_world_camera.inverse();
    const glm::dvec3 p_world(surfels_->position_m[i]);
    const glm::dmat3 R = glm::mat3_cast(glm::dquat(surfels_->R_world_surfel[i]));
    const glm::dvec2 scale(surfels_->scale_m[i]);
    CameraSurfel s{};
    s.index = i;
    s.centre_m = (T_camera_world * core::Point<core::frame::World>{p_world}).xyz_m;
    s.u_m = T_camera_world.rotation() * (R[0] * scale.x);
    s.v_m = T_camera_world.rotation() * (R[1] * scale.y);
    const glm::dvec3 eye_m = T_world_camera.translation_m();
    s.normal_world = glm::normalize(R[2]);
    if (glm::dot(s.normal_world, p_world - eye_m) > 0.0) s.normal_world = -s.normal_world;
    s.colour = colour_of(i, eye_m);
    s.opacity = surfels_->opacity[i];
    s.k2 = extent_squared(s.opacity);
    s.centre_px = intrinsics.project(s.centre_m);
    const double reach_m = std::sqrt(s.k2 * (s.u_m.z * s.u_m.z + s.v_m.z * s.v_m.z));
    s.z_min_m = std::max(s.centre_m.z - reach_m, static_cast<double>(options_.near_m));
    s.z_max_m = s.centre_m.z + reach_m;
    return s;
  }

  [[nodiscard]] std::vector<CameraSurfel> sorted_surfels(
      const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics) const {
    const auto key_camera = internal::projection_camera<float>(T_world_camera, intrinsics);
    const auto camera = internal::projection_camera<double>(T_world_camera, intrinsics);
    std::vector<CameraSurfel> sorted;
    for (std::size_t i = 0; i < surfels_->size(); ++i) {
      const glm::vec3& p = surfels_->position_m[i];
      const float key = depth_of_centre<float>(key_camera, {p.x, p.y, p.z});
      if (!(key > options_.near_m) || extent_squared(surfels_->opacity[i]) <= 0.0F) continue;
      sorted.push_back(in_camera(i, T_world_camera, intrinsics));
      CameraSurfel& s = sorted.back();
      s.depth_key = key;
      const glm::dmat3 R = glm::mat3_cast(glm::dquat(surfels_->R_world_surfel[i]));
      const glm::dvec3 u = R[0] * static_cast<double>(surfels_->scale_m[i].x);
      const glm::dvec3 v = R[1] * static_cast<double>(surfels_->scale_m[i].y);
      s.edge_on =
          project_surfel<double>(camera, {p.x, p.y, p.z}, {u.x, u.y, u.z}, {v.x, v.y, v.z})
              .edge_on;
    }
    std::stable_sort(sorted.begin(), sorted.end(),
                     [](const CameraSurfel& a, const CameraSurfel& b) {
                       return a.depth_key < b.depth_key;
                     });
    return sorted;
  }

  /// Alpha and depth of one surfel at an image position; alpha 0 if it is not hit.
  [[nodiscard]] Contribution meet(const CameraSurfel& s,
                                  const core::CameraIntrinsics& intrinsics,
                                  const glm::dvec2& px) const {
    const glm::dvec2 offset = px - s.centre_px;
    const double rho_low_pass = 2.0 * glm::dot(offset, offset);
    double rho_disc = std::numeric_limits<double>::infinity();
    double depth_m = s.centre_m.z;
    if (!s.edge_on) {
      const glm::dvec3 ray = intrinsics.back_project(px, 1.0);
      const glm::dvec3 normal = glm::cross(s.u_m, s.v_m);
      const double along = glm::dot(normal, ray);
      depth_m = glm::dot(normal, s.centre_m) / along;
      if (depth_m >= options_.near_m && std::isfinite(depth_m)) {
        const glm::dvec3 on_disc = ray * depth_m - s.centre_m;
        const double u = glm::dot(on_disc, s.u_m) / glm::dot(s.u_m, s.u_m);
        const double v = glm::dot(on_disc, s.v_m) / glm::dot(s.v_m, s.v_m);
        rho_disc = u * u + v * v;
      } else if (!(depth_m > 0.0)) {
        depth_m = s.z_max_m;  // The plane recedes beyond the horizon.
      }
    }
    const double rho = std::min(rho_disc, rho_low_pass);
    if (rho > s.k2) return {0.0, 0.0};
    const double alpha =
        std::min(static_cast<double>(kMaxAlpha), s.opacity * std::exp(-0.5 * rho));
    return {alpha, std::clamp(depth_m, s.z_min_m, s.z_max_m)};
  }

  [[nodiscard]] Pixel blend(const std::vector<CameraSurfel>& sorted,
                            const core::CameraIntrinsics& intrinsics, const glm::dvec2& px,
                            core::RenderStats& stats) const {
    Pixel pixel;
    for (const CameraSurfel& s : sorted) {
      const Contribution hit = meet(s, intrinsics, px);
      if (hit.alpha == 0.0) continue;
      ++stats.evaluations;
      ++stats.contributions;
      const double left = pixel.transmittance * (1.0 - hit.alpha);
      if (left < static_cast<double>(kStopTransmittance)) break;
      const double weight = pixel.transmittance * hit.alpha;
      if (pixel.transmittance > 1.0 - static_cast<double>(kMinSurfaceAlpha)) {
        pixel.median_depth = hit.depth_m;
      }
      pixel.transmittance = left;
      pixel.colour += weight * s.colour;
      pixel.normal += weight * s.normal_world;
      pixel.depth += weight * hit.depth_m;
      pixel.weights.emplace_back(weight, s.index);
    }
    return pixel;
  }

  void write_labels(Pixel& pixel, int x, int y, core::Frame& frame) const {
    const auto kept = std::min(pixel.weights.size(), static_cast<std::size_t>(options_.top_k));
    std::stable_sort(pixel.weights.begin(), pixel.weights.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
    std::map<std::uint16_t, double> semantic, instance;
    double total = 0.0;
    for (std::size_t k = 0; k < kept; ++k) {
      const auto [weight, surfel] = pixel.weights[k];
      semantic[surfels_->semantic_id[surfel]] += weight;
      instance[surfels_->instance_id[surfel]] += weight;
      total += weight;
    }
    const auto lighter = [](const auto& a, const auto& b) { return a.second < b.second; };
    const auto best = std::max_element(semantic.begin(), semantic.end(), lighter);
    frame.semantic(x, y) = best->first;
    frame.confidence(x, y) = static_cast<float>(best->second / total);
    frame.instance(x, y) = std::max_element(instance.begin(), instance.end(), lighter)->first;
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
    if (has(channels, Channels::kDepth)) {
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
    if (has(channels, Channels::kLabels) && surfels_->has_labels() && surface) {
      write_labels(pixel, x, y, frame);
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
