#include "experiments/scenes/coverage.h"

#include <cstdio>
#include <numbers>
#include <numeric>

#include <glm/vec2.hpp>

#include "core/error.h"
#include "core/random.h"

namespace segsim::experiments::scenes {
namespace {

constexpr const char* kMeanName = "robot_view_mean_alpha";
constexpr const char* kThinName = "robot_views_thin_share";
constexpr std::uint64_t kSeed = 1;

}  // namespace

std::vector<std::pair<std::string, double>> RobotCoverage::listing() const {
  const double share = views > 0 ? static_cast<double>(thin_views) / views : 0.0;
  return {{kMeanName, mean_alpha}, {kThinName, share}};
}

std::vector<glm::dvec2> reachable_cells_m(const sim::World& world) {
  const sim::FreeSpace& space = world.free_space();
  std::vector<glm::dvec2> cells_m;
  for (int y = 0; y < space.island.height_px(); ++y) {
    for (int x = 0; x < space.island.width_px(); ++x) {
      if (space.island(x, y) == 1) cells_m.push_back(space.frame.center_m(x, y));
    }
  }
  if (cells_m.empty()) {
    throw core::InputError::expected(world.manifest().name, "room for the robot", "none");
  }
  return cells_m;
}

RobotCoverage robot_coverage(core::Renderer& renderer, const sim::World& world,
                             double camera_height_m, int views) {
  const std::vector<glm::dvec2> cells_m = reachable_cells_m(world);
  const auto camera = core::CameraIntrinsics::from_fov(160, 120, std::numbers::pi / 2.0);
  const auto T_robot_camera = core::mast_camera(camera_height_m, 0.0);
  core::RandomStream random(kSeed, "robot_coverage");
  RobotCoverage coverage;
  core::Frame frame;
  for (; coverage.views < views; ++coverage.views) {
    const glm::dvec2 p_m = cells_m[random.index(static_cast<std::uint32_t>(cells_m.size()))];
    const core::Pose2 pose{p_m.x, p_m.y, random.uniform(-std::numbers::pi, std::numbers::pi)};
    const core::CameraPose T_world_camera =
        core::transform_from_pose2<core::frame::World>(pose) * T_robot_camera;
    renderer.render(T_world_camera, camera, core::Channels::kRgb, frame);
    const auto& alpha = frame.alpha.pixels();
    const double mean =
        std::accumulate(alpha.begin(), alpha.end(), 0.0) / static_cast<double>(alpha.size());
    coverage.mean_alpha += mean / views;
    coverage.thin_views += mean < kMinCoverage ? 1 : 0;
  }
  return coverage;
}

std::string coverage_warning(const core::SceneManifest& manifest) {
  double mean = 1.0, thin = 0.0;
  for (const auto& [name, value] : manifest.statistics) {
    if (name == kMeanName) mean = value;
    if (name == kThinName) thin = value;
  }
  if (mean >= kMinCoverage && thin <= kMaxThinShare) return {};
  char text[192];
  std::snprintf(text, sizeof text,
                "the reconstruction covers %.0f %% of what a robot sees; %.0f %% of its views "
                "are covered by less than %.0f %%",
                100.0 * mean, 100.0 * thin, 100.0 * kMinCoverage);
  return text;
}

}  // namespace segsim::experiments::scenes
