#include "experiments/benchmarks/bench_scene.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/bundle_parts.h"
#include "core/check.h"
#include "core/error.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "experiments/scenes/scene_surfels.h"
#include "renderer/files/ply_io.h"
#include "renderer/scene/room_scene.h"
#include "sim/ground/navmesh.h"

namespace segsim::experiments::benchmarks {
namespace {

namespace fs = std::filesystem;

constexpr double kLookDown_rad = 0.1;

/// Corners of a walk between random points of the largest island.
std::vector<glm::dvec3> random_walk(const sim::Navmesh& navmesh, std::uint64_t seed) {
  constexpr int kGoals = 8;
  core::RandomStream random(seed, "bench_scene.walk");
  std::vector<glm::dvec3> corners{navmesh.random_point(random)};
  for (int goal = 0; goal < kGoals; ++goal) {
    const auto path = navmesh.find_path(corners.back(), navmesh.random_point(random));
    if (!path) continue;
    corners.insert(corners.end(), path->corners_m.begin(), path->corners_m.end());
  }
  return corners;
}

/// `count` places at equal distances along the walk, each looking along its stretch.
std::vector<core::CameraPose> walk_cameras(const std::vector<glm::dvec3>& corners, int count,
                                           double height_m) {
  double length_m = 0.0;
  for (std::size_t i = 1; i < corners.size(); ++i) {
    length_m += glm::distance(corners[i - 1], corners[i]);
  }
  std::vector<core::CameraPose> cameras;
  double passed_m = 0.0;
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const glm::dvec3 step = corners[i] - corners[i - 1];
    const double step_m = glm::length(step);
    if (step_m < 1e-6) continue;
    while (static_cast<int>(cameras.size()) < count) {
      const double at_m =
          (static_cast<double>(cameras.size()) + 0.5) * length_m / count - passed_m;
      if (at_m > step_m) break;
      const glm::dvec3 p = corners[i - 1] + step * (std::max(0.0, at_m) / step_m);
      const core::Pose2 base{p.x, p.y, std::atan2(step.y, step.x)};
      cameras.push_back(core::transform_from_pose2<core::frame::World>(base, p.z) *
                        core::mast_camera(height_m, kLookDown_rad));
    }
    passed_m += step_m;
  }
  return cameras;
}

/// A ring at half the extent of the middle 90 % of the surfels, looking across the middle.
std::vector<core::CameraPose> ring_within(const renderer::SurfelCloud& surfels, int count) {
  glm::dvec3 low(0.0), high(0.0);
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<float> values;
    values.reserve(surfels.size());
    for (const glm::vec3& p : surfels.position_m) values.push_back(p[axis]);
    std::sort(values.begin(), values.end());
    low[axis] = values[values.size() / 20];
    high[axis] = values[values.size() - 1 - values.size() / 20];
  }
  const glm::dvec3 middle = 0.5 * (low + high), half = 0.5 * (high - low) + 1e-3;
  std::vector<core::CameraPose> cameras;
  for (int i = 0; i < count; ++i) {
    const double a = 2.0 * std::numbers::pi * i / count;
    const glm::dvec3 side(0.5 * half.x * std::cos(a), 0.5 * half.y * std::sin(a), 0.0);
    cameras.push_back(
        core::look_at(middle + side, middle - side - glm::dvec3(0.0, 0.0, 0.2 * half.z)));
  }
  return cameras;
}

BenchScene make_room(const BenchSceneOptions& options) {
  renderer::RoomSceneOptions room;
  room.surfel_count = options.surfels;
  room.seed = options.seed;
  room.spread = options.spread;
  room.rooms = options.rooms;
  room.features = options.features;
  BenchScene scene;
  char name[96];
  std::snprintf(name, sizeof name, "room, %d surfels, spread %g, seed %llu, %d room%s",
                options.surfels, options.spread, static_cast<unsigned long long>(options.seed),
                options.rooms, options.rooms == 1 ? "" : "s");
  scene.name = name;
  scene.surfels = std::make_shared<renderer::SurfelCloud>(renderer::make_room_scene(room));
  scene.path = renderer::room_camera_ring(options.views);
  scene.focal_per_width = renderer::room_camera(1, 1).fx_px;
  return scene;
}

}  // namespace

core::CameraIntrinsics BenchScene::camera(int width_px, int height_px) const {
  const double focal_px = focal_per_width * width_px;
  return {width_px, height_px, focal_px, focal_px, 0.5 * width_px, 0.5 * height_px};
}

BenchScene load_bench_scene(const BenchSceneOptions& options) {
  SEGSIM_CHECK(options.views > 0, "views = " + std::to_string(options.views));
  if (options.scene == "room") return make_room(options);
  BenchScene scene;
  const fs::path place = options.scene;
  scene.name = place.filename().empty() ? place.parent_path().filename().string()
                                        : place.filename().string();
  scene.focal_per_width = 0.5 / std::tan(0.5 * options.hfov_deg * std::numbers::pi / 180.0);
  if (place.extension() == ".ply") {
    auto surfels = std::make_shared<renderer::SurfelCloud>(renderer::read_surfels_ply(place));
    if (surfels->size() == 0) {
      throw core::InputError::expected(place.string(), "surfels", "none");
    }
    scene.path = ring_within(*surfels, options.views);
    scene.surfels = std::move(surfels);
    return scene;
  }
  const core::SceneBundle bundle = core::load_bundle(place);
  core::require_drivable(bundle);  // The cameras walk.
  const scenes::SceneSurfels drawn = scenes::load_scene_surfels(bundle);
  scene.surfels = drawn.surfels;
  scene.labels = drawn.labels;
  scene.classes = bundle.manifest.classes;
  if (scene.labels) scene.name += ", label distributions";
  const sim::Navmesh navmesh = sim::Navmesh::load(bundle.navmesh_file());
  scene.path = walk_cameras(random_walk(navmesh, options.seed), options.views,
                            bundle.manifest.camera_height_m);
  if (scene.path.empty()) {
    throw core::InputError::expected(place.string(), "a navmesh with room to walk", "none");
  }
  return scene;
}

}  // namespace segsim::experiments::benchmarks
