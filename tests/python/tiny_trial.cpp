// The scene of the tests of environments, and what a trial in it makes of commands:
//
//   tiny_trial scene FOLDER                     writes FOLDER/bundle and FOLDER/episodes.jsonl
//   tiny_trial run FOLDER EPISODE ROBOT PERIOD_S   reads "v w" of each tick from standard
//   input; then the
//                                               robot stops. Prints JSON with poses and
//                                               result.
#include <cstdio>
#include <iostream>
#include <string>

#include "experiments/episodes/episodes.h"
#include "renderer/cpu_renderer.h"
#include "renderer/files/scene_surfels.h"
#include "sim/trial/oracle_detector.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim {
namespace {

namespace fs = std::filesystem;
namespace episodes = experiments::episodes;

core::CameraIntrinsics camera() {
  return core::CameraIntrinsics::from_fov(64, 48, 1.2217304763960306);
}

class Playback final : public core::Policy {
 public:
  void reset(const core::ObjectGoal&, std::uint64_t) override {}
  core::Decision decide(const core::Observation&, std::span<const core::Detection>) override {
    core::VelocityCommand command;
    if (std::cin >> command.forward_mps >> command.turn_radps) {
      return {command, core::PolicyMode::kExplore};
    }
    return {{}, core::PolicyMode::kStop, core::StopReason::kGoalReached};
  }
  core::PolicyView view() const override { return {}; }
};

int write_scene(const fs::path& folder) {
  const fs::path place = experiments::TinyScene().write(folder / "bundle");
  const core::SceneBundle bundle = core::load_bundle(place);
  const sim::World world = sim::World::load(bundle, sim::RobotModel::jackal());
  const renderer::SceneSurfels scene = renderer::load_scene_surfels(bundle);
  const auto eye = renderer::make_cpu_renderer(scene.surfels, {.threads = 1}, scene.labels);
  episodes::EpisodeRules rules;
  rules.goals = {"couch", "chair"};
  rules.count = 12;
  rules.min_start_m = 0.5;
  rules.allow_visible_start = true;
  rules.camera = camera();
  episodes::write_episodes(folder / "episodes.jsonl",
                           episodes::generate_episodes("tiny", bundle, world, *eye, rules));
  return 0;
}

int run(const fs::path& folder, std::size_t index, const std::string& robot_name,
        double period_s) {
  const core::SceneBundle bundle = core::load_bundle(folder / "bundle");
  const sim::RobotModel robot = sim::RobotModel::by_name(robot_name);
  const sim::World world = sim::World::load(bundle, robot);
  const renderer::SceneSurfels scene = renderer::load_scene_surfels(bundle);
  const auto eye = renderer::make_cpu_renderer(scene.surfels, {.threads = 1}, scene.labels);
  const episodes::EpisodeSet set = episodes::read_episodes(folder / "episodes.jsonl");
  sim::TrialOptions options;
  options.camera = camera();
  options.control_period_s = period_s;
  options.camera_height_m = robot.camera_height_m;
  sim::OracleDetector detector(bundle.manifest.classes, {"couch", "chair"});
  Playback policy;
  const sim::TrialResult result = sim::run_trial({.episode = set.episodes.at(index),
                                                  .options = options,
                                                  .world = world,
                                                  .robot = robot,
                                                  .renderer = *eye,
                                                  .detector = detector,
                                                  .policy = policy,
                                                  .truth = &detector});
  std::printf("{\"outcome\": \"%s\", \"success\": %s, \"spl\": %.17g, \"soft_spl\": %.17g, ",
              sim::to_string(result.outcome), result.success ? "true" : "false", result.spl,
              result.soft_spl);
  std::printf("\"distance_m\": %.17g, \"path_m\": %.17g, \"collisions\": %d, \"poses\": [",
              result.distance_to_goal_m, result.path_m, result.contacts);
  for (std::size_t k = 0; k < result.track.size(); ++k) {
    const core::Pose2& pose = result.track[k].pose;
    std::printf("%s[%.17g, %.17g, %.17g]", k == 0 ? "" : ", ", pose.x_m, pose.y_m,
                pose.yaw_rad);
  }
  std::printf("]}\n");
  return 0;
}

}  // namespace
}  // namespace segsim

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  if (what == "scene" && argc == 3) return segsim::write_scene(argv[2]);
  if (what == "run" && argc == 6) {
    return segsim::run(argv[2], std::stoul(argv[3]), argv[4], std::stod(argv[5]));
  }
  return 2;
}
