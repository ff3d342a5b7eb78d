// `segsim sensors`: one view of a scene as each sensor model delivers it.
#include <cstdio>
#include <memory>
#include <numbers>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/scene_bundle.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/trials/sensor_picture.h"
#include "perception/data/image_file.h"
#include "renderer/cpu_renderer.h"
#include "sim/ground/robot.h"
#include "sim/ground/world.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct SensorsFlags {
  fs::path bundle, output = "sensors.png";
  std::vector<double> pose;
  double camera_height_m = 0.0, turn_radps = 1.0;
  std::uint64_t seed = 1;
};

void draw(const SensorsFlags& flags) {
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  const sim::World world = sim::World::load(bundle, sim::RobotModel::jackal_gentle());
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  const auto renderer = renderer::make_cpu_renderer(scene.surfels, {}, scene.labels);
  trials::SensorSheetOptions options;
  options.pose = flags.pose.empty() ? trials::roomiest_pose(world)
                                    : core::Pose2{flags.pose[0], flags.pose[1],
                                                  flags.pose[2] * std::numbers::pi / 180.0};
  options.camera_height_m =
      flags.camera_height_m > 0.0 ? flags.camera_height_m : bundle.manifest.camera_height_m;
  options.turn_radps = flags.turn_radps;
  options.seed = flags.seed;
  perception::write_image(
      flags.output, trials::draw_sensor_sheet(
                        *renderer, world, drawing::make_floor_plan(*scene.surfels), options));
  std::printf("%s: from (%.2f, %.2f), %.0f deg\n", flags.output.c_str(), options.pose.x_m,
              options.pose.y_m, options.pose.yaw_rad * 180.0 / std::numbers::pi);
}

}  // namespace

void add_sensors_command(CLI::App& app) {
  auto flags = std::make_shared<SensorsFlags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "sensors");
  command->add_option("bundle", flags->bundle, "Scene bundle")->required();
  command->add_option("-o,--output", flags->output, "Picture to write")->capture_default_str();
  command
      ->add_option(
          "--pose", flags->pose,
          "Where the robot stands: X Y [m] and heading [deg] (default: where there is "
          "the most room, heading 0)")
      ->expected(3)
      ->check(light::coordinate());
  command
      ->add_option("--camera-height", flags->camera_height_m,
                   "Of the camera [m] (default: the bundle's)")
      ->check(CLI::Range(0.05, 3.0));
  command->add_option("--turn", flags->turn_radps, "Speed that blurs and smears [rad/s]")
      ->check(CLI::Range(-10.0, 10.0))
      ->capture_default_str();
  command->add_option("--seed", flags->seed, "Of the noise")->capture_default_str();
  command->callback([flags] { draw(*flags); });
}

}  // namespace segsim::experiments::commands
