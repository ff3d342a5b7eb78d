#include "worlds/capture/mesh_renderer.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "core/check.h"
#include "core/task_order.h"
#include "sim/ground/ray_scene.h"
#include "worlds/capture/irradiance_cache.h"
#include "worlds/capture/surface_shading.h"

namespace segsim::worlds {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr int kPacket = 8;

/// Linear up to 0.6, then an exponential shoulder towards 1: lamps do not clip to flat
/// patches.
float tone_map(float x) {
  constexpr float kKnee = 0.6F;
  if (x <= kKnee) return x;
  return 1.0F - (1.0F - kKnee) * std::exp(-(x - kKnee) / (1.0F - kKnee));
}

/// Rays of one camera; a direction has length 1 along the camera's +z, so t is the depth.
struct CameraRays {
  glm::vec3 origin_m;
  glm::mat3 R_world_camera;
  core::CameraIntrinsics intrinsics;

  CameraRays(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& camera)
      : origin_m(T_world_camera.translation_m()),
        R_world_camera(glm::mat3(glm::mat3_cast(T_world_camera.rotation()))),
        intrinsics(camera) {}

  [[nodiscard]] glm::vec3 direction(double x_px, double y_px) const {
    return R_world_camera * glm::vec3(intrinsics.back_project({x_px, y_px}, 1.0));
  }
};

struct Labels {
  std::uint16_t class_id = 0, instance_id = 0;
};

void prepare(core::Frame& frame, const core::CameraPose& T_world_camera,
             const core::CameraIntrinsics& camera, core::Channels channels) {
  frame.T_world_camera = T_world_camera;
  frame.intrinsics = camera;
  const auto size = [&](auto& image, core::Channels channel) {
    const bool wanted = core::has(channels, channel);
    image.resize(wanted ? camera.width_px : 0, wanted ? camera.height_px : 0);
  };
  size(frame.rgb, core::Channels::kRgb);
  size(frame.depth_m, core::Channels::kDepth);
  size(frame.normal, core::Channels::kNormal);
  size(frame.semantic, core::Channels::kLabels);
  size(frame.instance, core::Channels::kLabels);
  size(frame.confidence, core::Channels::kLabels);
  size(frame.alpha, core::Channels::kNone);  // Always: every set contains the empty one.
}

class MeshRenderer final : public core::Renderer {
 public:
  MeshRenderer(const sim::MeshScene& scene, const MeshRenderOptions& options)
      : options_(options),
        rays_(scene, options.threads),
        surfaces_(scene),
        light_(scene, rays_, surfaces_,
               {options.cell_m, options.shadow_samples, options.bounce_samples}),
        arena_(options.threads == 0 ? tbb::task_arena::automatic : options.threads) {
    for (const sim::SubMesh& mesh : scene.meshes) {
      labels_.push_back({mesh.class_id, mesh.instance_id});
    }
    if (options_.exposure <= 0.0F) {
      // A white wall (0.8) in median light becomes 0.46 linear: bright, with room above.
      const float median = light_.median_irradiance();
      options_.exposure = median > 0.0F ? 0.58F * kPi / median : 1.0F;
    }
  }

  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels channels, core::Frame& frame) override {
    SEGSIM_CHECK(intrinsics.width_px > 0 && intrinsics.height_px > 0, "empty image");
    SEGSIM_CHECK(intrinsics.fx_px > 0 && intrinsics.fy_px > 0, "focal length");
    const auto start = std::chrono::steady_clock::now();
    prepare(frame, T_world_camera, intrinsics, channels);
    const CameraRays camera(T_world_camera, intrinsics);
    const auto render_row = [&](int y) {
      for (int x = 0; x < intrinsics.width_px; x += kPacket) {
        write_geometry(camera, channels, x, y, frame);
        if (core::has(channels, core::Channels::kRgb)) write_colour(camera, x, y, frame);
      }
    };
    if (options_.threads == 1) {
      for (int y = 0; y < intrinsics.height_px; ++y) render_row(y);
    } else {
      core::TaskOrder order;
      arena_.execute([&] {
        tbb::parallel_for(0, intrinsics.height_px, [&](int y) {
          const core::TaskOrder::Task task(order);
          render_row(y);
        });
      });
      order.wait();
    }
    frame.stats = {};
    frame.stats.evaluations = frame.alpha.size();
    frame.stats.render_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count();
  }
  using core::Renderer::render;

 private:
  /// Everything but colour for the pixels (x .. x + 7, y): one ray through each centre.
  void write_geometry(const CameraRays& camera, core::Channels channels, int x, int y,
                      core::Frame& frame) const {
    std::array<glm::vec3, kPacket> directions;
    for (int i = 0; i < kPacket; ++i) {
      directions[static_cast<std::size_t>(i)] = camera.direction(x + i + 0.5, y + 0.5);
    }
    const auto hits = rays_.cast8(camera.origin_m, directions);
    for (int i = 0; i < kPacket && x + i < camera.intrinsics.width_px; ++i) {
      const sim::RayHit& hit = hits[static_cast<std::size_t>(i)];
      const glm::vec3& direction = directions[static_cast<std::size_t>(i)];
      frame.alpha(x + i, y) = hit.hit() ? 1.0F : 0.0F;
      if (core::has(channels, core::Channels::kDepth)) {
        frame.depth_m(x + i, y) = hit.hit() ? hit.t : std::numeric_limits<float>::quiet_NaN();
      }
      if (core::has(channels, core::Channels::kNormal)) {
        frame.normal(x + i, y) =
            glm::dot(hit.normal, direction) > 0.0F ? -hit.normal : hit.normal;
      }
      if (core::has(channels, core::Channels::kLabels)) {
        const Labels labels = hit.hit() ? labels_[hit.mesh] : Labels{};
        frame.semantic(x + i, y) = labels.class_id;
        frame.instance(x + i, y) = labels.instance_id;
        frame.confidence(x + i, y) = hit.hit() ? 1.0F : 0.0F;
      }
    }
  }

  /// The light that was found last in a pixel; its other samples mostly lie on the same
  /// surface.
  struct RecentLight {
    std::uint32_t mesh = sim::RayHit::kNone;
    glm::vec3 point_m{0.0F}, normal{0.0F}, irradiance{0.0F};
  };

  void write_colour(const CameraRays& camera, int x, int y, core::Frame& frame) const {
    const int side = options_.samples_per_side;
    std::array<glm::vec3, kPacket> sums{};
    std::array<RecentLight, kPacket> recent;
    for (int sample = 0; sample < side * side; ++sample) {
      const int column = sample % side, row = sample / side;
      const double dx = (column + 0.5) / side;
      const double dy = (row + 0.5) / side;
      std::array<glm::vec3, kPacket> directions;
      for (int i = 0; i < kPacket; ++i) {
        directions[static_cast<std::size_t>(i)] = camera.direction(x + i + dx, y + dy);
      }
      const auto hits = rays_.cast8(camera.origin_m, directions);
      for (std::size_t i = 0;
           i < kPacket && x + static_cast<int>(i) < camera.intrinsics.width_px; ++i) {
        sums[i] += radiance(camera, directions[i], hits[i], recent[i]);
      }
    }
    for (int i = 0; i < kPacket && x + i < camera.intrinsics.width_px; ++i) {
      frame.rgb(x + i, y) = srgb_from_linear(sums[static_cast<std::size_t>(i)] /
                                             static_cast<float>(side * side));
    }
  }

  /// Display-referred linear colour of one ray.
  [[nodiscard]] glm::vec3 radiance(const CameraRays& camera, const glm::vec3& direction,
                                   const sim::RayHit& hit, RecentLight& recent) const {
    if (!hit.hit()) return options_.sky;
    const glm::vec3 facing = glm::dot(hit.normal, direction) > 0.0F ? -hit.normal : hit.normal;
    const glm::vec3 normal = surfaces_.smooth_normal(hit, direction);
    const glm::vec3 point = camera.origin_m + hit.t * direction;
    const glm::vec3 apart = point - recent.point_m;
    const bool same = recent.mesh == hit.mesh && glm::dot(recent.normal, normal) > 0.98F &&
                      glm::dot(apart, apart) < 0.25F * options_.cell_m * options_.cell_m;
    if (!same) recent = {hit.mesh, point, normal, light_.at(point, facing, normal)};

    const float cosine = std::abs(glm::dot(facing, direction)) / glm::length(direction);
    const float pixel_m = hit.t / static_cast<float>(camera.intrinsics.fx_px);
    const float footprint_m =
        pixel_m / static_cast<float>(options_.samples_per_side) / std::max(cosine, 0.2F);
    const glm::vec3 reflected = surfaces_.albedo(hit, footprint_m) * recent.irradiance / kPi;
    const glm::vec3 exposed = options_.exposure * (surfaces_.emission(hit) + reflected);
    return {tone_map(exposed.x), tone_map(exposed.y), tone_map(exposed.z)};
  }

  MeshRenderOptions options_;
  sim::RayScene rays_;
  SurfaceShading surfaces_;
  IrradianceCache light_;
  std::vector<Labels> labels_;  ///< Per mesh.
  tbb::task_arena arena_;
};

}  // namespace

std::unique_ptr<core::Renderer> make_mesh_renderer(const sim::MeshScene& scene,
                                                   const MeshRenderOptions& options) {
  SEGSIM_CHECK(options.threads >= 0, std::to_string(options.threads));
  SEGSIM_CHECK(options.samples_per_side >= 1, std::to_string(options.samples_per_side));
  return std::make_unique<MeshRenderer>(scene, options);
}

}  // namespace segsim::worlds
