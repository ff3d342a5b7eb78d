// `segsim scene coverage`.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <numbers>
#include <ostream>
#include <string>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "core/scene_bundle.h"
#include "experiments/commands/scene/scene_commands.h"
#include "experiments/scenes/coverage_guide.h"
#include "experiments/scenes/scene_surfels.h"
#include "perception/data/image_file.h"
#include "renderer/renderer_backend.h"

namespace segsim::experiments::commands::scene {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Flags {
  fs::path bundle, picture, json;
  std::string robot = "jackal-gentle", backend = "cpu";
  double height_m = 0.0;  ///< 0: the bundle's.
  scenes::CoverageGuideOptions options;
};

double degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

void print(const scenes::CoverageGuide& guide) {
  std::printf("a camera %.2f m high misses %.1f %% of what it looks at, from %zu places\n",
              guide.camera_height_m, 100.0 * guide.missing, guide.places.size());
  if (guide.poses.empty()) return;
  std::printf("\nmore frames help most from here (world frame):\n%4s %8s %8s %10s %8s\n", "",
              "x [m]", "y [m]", "yaw [deg]", "share");
  for (std::size_t i = 0; i < guide.poses.size(); ++i) {
    const auto& [pose, share] = guide.poses[i];
    std::printf("%4zu %8.2f %8.2f %10.0f %6.1f %%\n", i + 1, pose.x_m, pose.y_m,
                degrees(pose.yaw_rad), 100.0 * share);
  }
}

Json json_of(const scenes::CoverageGuide& guide) {
  Json places = Json::array(), poses = Json::array();
  for (const scenes::CoveragePlace& place : guide.places) {
    places.push_back({{"x_m", place.p_m.x}, {"y_m", place.p_m.y}, {"missing", place.missing}});
  }
  for (const auto& [pose, share] : guide.poses) {
    poses.push_back(
        {{"x_m", pose.x_m}, {"y_m", pose.y_m}, {"yaw_rad", pose.yaw_rad}, {"share", share}});
  }
  return {{"schema", "segsim.coverage/1"},
          {"camera_height_m", guide.camera_height_m},
          {"missing", guide.missing},
          {"places", places},
          {"poses", poses}};
}

void run(const Flags& flags) {
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  const sim::World world = sim::World::load(bundle, sim::RobotModel::by_name(flags.robot));
  const auto renderer =
      renderer::make_renderer(renderer::backend_of(flags.backend), scene.surfels);
  scenes::CoverageGuideOptions options = flags.options;
  options.camera_height_m =
      flags.height_m > 0.0 ? flags.height_m : bundle.manifest.camera_height_m;
  const scenes::CoverageGuide guide =
      scenes::coverage_guide(*renderer, world, scenes::scene_box(*scene.surfels), options);
  print(guide);
  if (!flags.picture.empty()) {
    perception::write_image(
        flags.picture,
        scenes::coverage_picture(drawing::make_floor_plan(*scene.surfels), guide));
    std::printf("\npicture: %s\n", flags.picture.string().c_str());
  }
  if (!flags.json.empty()) {
    core::write_file_atomically(
        flags.json, [&](std::ostream& out) { out << json_of(guide).dump(1) << "\n"; });
  }
}

}  // namespace

void add_scene_coverage(CLI::App& scene) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = scene.add_subcommand(
      "coverage", "What a robot would not see in the reconstruction, and which frames help");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("--picture", flags->picture, "Write a map of it (PNG)");
  command->add_option("--json", flags->json, "Write all places and poses");
  command->add_option("--robot", flags->robot, "Whose free space it is")
      ->capture_default_str();
  command->add_option("--height", flags->height_m, "Of the camera [m] (default: the bundle's)")
      ->check(CLI::Range(0.05, 10.0));
  command->add_option("--spacing", flags->options.spacing_m, "Between places [m]")
      ->check(CLI::Range(0.1, 10.0))
      ->capture_default_str();
  command->add_option("--poses", flags->options.poses, "Wanted frames")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command->callback([flags] { run(*flags); });
}

}  // namespace segsim::experiments::commands::scene
