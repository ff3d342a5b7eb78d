// The scene of the tests of environments, and what a trial in it makes of commands:
//
//   tiny_trial scene FOLDER
//       writes FOLDER/bundle and FOLDER/episodes.jsonl
//   tiny_trial run FOLDER EPISODE ROBOT PERIOD_S
//       reads "v w" of each tick from standard input; then the robot stops. Prints JSON with
//       poses and result.
//   tiny_trial bench FOLDER N WIDTH HEIGHT STEPS THREADS
//       prints the seconds that N environments take for steps: by the clock, of processors
#include <chrono>
#include <cstdio>
#include <ctime>
#include <iostream>
#include <string>

#include "experiments/episodes/episodes.h"
#include "renderer/cpu_renderer.h"
#include "renderer/files/scene_surfels.h"
#include "sim/trial/environment/discrete_actions.h"
#include "sim/trial/environment/vector_environment.h"
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

/// The steps of tests/python/bench_environments.py.
int bench(const fs::path& folder, std::size_t count, int width_px, int height_px, int steps,
          int threads) {
  const core::SceneBundle bundle = core::load_bundle(folder / "bundle");
  const sim::World world = sim::World::load(bundle, sim::RobotModel::jackal());
  const renderer::SceneSurfels scene = renderer::load_scene_surfels(bundle);
  const sim::EpisodePool pool(world,
                              episodes::read_episodes(folder / "episodes.jsonl").episodes);
  sim::EnvironmentOptions options;
  options.trial.camera =
      core::CameraIntrinsics::from_fov(width_px, height_px, 1.2217304763960306);
  options.trial.camera_height_m = world.robot().camera_height_m;
  sim::VectorEnvironment environments(
      pool, options, {count, threads}, sim::EpisodeOrder::Kind::kShuffled, [&](int each) {
        return renderer::make_cpu_renderer(scene.surfels, {.threads = each}, scene.labels);
      });
  const sim::DiscreteActions discrete(world.robot(), options.trial.control_period_s,
                                      options.trial.substep_s);
  std::vector<sim::VectorEnvironment::Reset> resets(count);
  for (std::size_t i = 0; i < count; ++i) resets[i] = {true, i};
  std::size_t images = 0;
  const auto look = [](std::size_t, const sim::ObjectNavEnvironment&) {};
  environments.reset(resets, look);
  std::vector<sim::EnvironmentAction> actions(count);
  const std::clock_t cpu_start = std::clock();
  const auto start = std::chrono::steady_clock::now();
  for (int k = 0; k < steps; ++k) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto number = 1 + (static_cast<std::size_t>(k) + i) * (k % 5 + 1U) % 3;
      actions[i] = {false, discrete.commands(static_cast<sim::DiscreteAction>(number))};
    }
    images += environments.step(actions, look).size();
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  const double cpu_s = static_cast<double>(std::clock() - cpu_start) / CLOCKS_PER_SEC;
  std::printf("%.9g %.9g\n", images == 0 ? 0.0 : took.count(), cpu_s);
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
  if (what == "bench" && argc == 8) {
    return segsim::bench(argv[2], std::stoul(argv[3]), std::stoi(argv[4]), std::stoi(argv[5]),
                         std::stoi(argv[6]), std::stoi(argv[7]));
  }
  return 2;
}
