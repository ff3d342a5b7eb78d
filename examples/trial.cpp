// A trial from C++: scene, robot, episode, result.
//
//     trial [SEED]
//
// Furnishes a flat from the seed, puts a Clearpath Jackal into it and lets the frontier policy
// look for a couch. The detector is the oracle, which reads the rendered labels: what is
// judged here is the search alone. Writes into the current folder: trial.ppm, the map that the
// robot made (free floor white, obstacles black, never seen grey), with its track in red and
// its start in green.

#include <iostream>
#include <string>

#include "core/error.h"
#include "examples/picture.h"
#include "nav/policies/policy_registry.h"
#include "sim/trial/episode_sampling.h"
#include "sim/trial/oracle_detector.h"
#include "sim/trial/trial.h"
#include "worlds/capture/mesh_renderer.h"
#include "worlds/mesh/plain_mesh.h"
#include "worlds/procedural/procedural_flat.h"

using namespace segsim;

namespace {

constexpr const char* kGoal = "couch";

/// Starts where the navigable area allows, and ends near any couch.
sim::Episode make_episode(const sim::World& world, std::uint64_t seed) {
  const core::SceneManifest& manifest = world.manifest();
  const core::SceneClass* couch = manifest.find_class(kGoal);
  sim::Episode episode;
  episode.id = manifest.name + "/couch/0";
  episode.class_name = kGoal;
  episode.seed = seed;
  for (const core::SceneInstance& instance : manifest.instances) {
    if (couch == nullptr || instance.class_id != couch->id) continue;
    const auto near_it =
        sim::view_point_candidates(world, instance.box_min_m, instance.box_max_m);
    episode.view_points_m.insert(episode.view_points_m.end(), near_it.begin(), near_it.end());
  }
  const auto starts =
      sim::sample_starts(world, episode.view_points_m, 1, seed, {.min_geodesic_m = 4.0});
  if (starts.empty())
    throw core::InputError(
        "this flat has no couch, or none that is 4 m away from a place to start");
  episode.start = starts.front().pose;
  episode.shortest_path_m = starts.front().geodesic_m;
  return episode;
}

core::Image<core::Rgb8> picture_of(const sim::TrialResult& result) {
  const core::PolicyView& map = result.final_view;
  core::Image<core::Rgb8> image(map.cells.width_px(), map.cells.height_px());
  for (int y = 0; y < map.cells.height_px(); ++y) {
    for (int x = 0; x < map.cells.width_px(); ++x) {
      const int state = map.cells(x, y);  // 0 unknown, 1 free, 2 occupied, 3 too close.
      const std::uint8_t grey = state == 0 ? 170 : state == 2 ? 0 : 255;
      examples::paint(image, {x, y}, 0, {grey, grey, grey});
    }
  }
  // The robot knows its pose here, so its odometry frame is the world frame.
  const auto cell_of = [&map](const core::Pose2& pose) {
    return glm::ivec2((glm::dvec2(pose.x_m, pose.y_m) - map.origin_m) / map.resolution_m);
  };
  for (const sim::TickRecord& tick : result.track) {
    examples::paint(image, cell_of(tick.pose), 1, {230, 30, 30});
  }
  examples::paint(image, cell_of(result.track.front().pose), 4, {30, 170, 60});
  return image;
}

}  // namespace

int main(int argc, char** argv) try {
  const std::uint64_t seed = argc > 1 ? std::stoull(argv[1]) : 3;

  // The scene: what the camera sees, and what the robot stands on and bumps into.
  const sim::MeshScene flat = worlds::make_flat({.seed = seed});
  const auto camera = worlds::make_mesh_renderer(
      flat, {.samples_per_side = 1, .cell_m = 0.2F, .shadow_samples = 1, .bounce_samples = 1});
  const sim::RobotModel robot = sim::RobotModel::jackal_gentle();
  sim::World world = sim::World::from_mesh(worlds::plain_mesh(flat), robot);
  core::SceneManifest manifest;
  manifest.name = flat.name;
  manifest.classes = flat.classes;
  manifest.instances = flat.instances;
  world.set_manifest(manifest);

  // The task, and the rules by which it is judged.
  const sim::Episode episode = make_episode(world, seed);
  sim::TrialOptions options;
  options.camera = core::CameraIntrinsics::from_fov(160, 120, 1.4);
  options.control_period_s = 0.25;

  // The stages: a detector and a policy.
  sim::OracleDetector detector(flat.classes, {kGoal});
  nav::PolicyContext context;
  context.class_names = detector.class_names();
  context.robot = robot;
  context.camera_height_m = options.camera_height_m;
  const auto policy = nav::PolicyRegistry::instance().usual("frontier").make(context);

  const sim::TrialResult result = sim::run_trial({.episode = episode,
                                                  .options = options,
                                                  .world = world,
                                                  .robot = robot,
                                                  .renderer = *camera,
                                                  .detector = detector,
                                                  .policy = *policy,
                                                  .truth = &detector});

  examples::write_ppm("trial.ppm", picture_of(result));
  std::cout << "outcome " << to_string(result.outcome) << "\nstop_reason "
            << core::to_string(result.stop_reason) << "\nsimulated_s " << result.sim_s
            << "\npath_m " << result.path_m << "\nshortest_path_m " << result.shortest_path_m
            << "\nspl " << result.spl << "\ncontacts " << result.contacts << "\nstate_hash "
            << result.state_hash << '\n';
  return 0;
} catch (const core::InputError& error) {
  std::cerr << "error: " << error.what() << '\n';
  return 2;
}
