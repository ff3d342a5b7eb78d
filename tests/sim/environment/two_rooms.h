#pragma once

/// @file
/// Two rooms with a couch in the right one, for tests of environments, and a policy that plays
/// back commands: what an environment does is compared with what a trial does.

#include <memory>
#include <utility>
#include <vector>

#include "sim/trial/environment/object_nav_environment.h"
#include "sim/trial/oracle_detector.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"
#include "tests/sim/trial/box_renderer.h"

namespace segsim::sim {

/// Gives commands tick by tick; after the last one it stops, or goes on with the last one.
class PlaybackPolicy final : public core::Policy {
 public:
  PlaybackPolicy(std::vector<core::VelocityCommand> commands, bool stops)
      : commands_(std::move(commands)), stops_(stops) {}
  void reset(const core::ObjectGoal&, std::uint64_t) override { tick_ = 0; }
  core::Decision decide(const core::Observation&, std::span<const core::Detection>) override {
    if (tick_ == commands_.size() && stops_) {
      return {{}, core::PolicyMode::kStop, core::StopReason::kGoalReached};
    }
    if (tick_ < commands_.size()) ++tick_;
    return {commands_[tick_ - 1], core::PolicyMode::kExplore};
  }
  core::PolicyView view() const override { return {}; }

 private:
  std::vector<core::VelocityCommand> commands_;
  bool stops_;
  std::size_t tick_ = 0;
};

struct TwoRooms {
  static constexpr std::uint16_t kWall = 1, kCouch = 4;

  TwoRooms() : world(World::from_mesh(make_mesh(), RobotModel::jackal_gentle())) {
    core::SceneManifest manifest;
    manifest.classes = {{kWall, "wall", false}, {kCouch, "couch", true}};
    world.set_manifest(manifest);
    options.trial.camera = core::CameraIntrinsics::from_fov(64, 48, 1.4);
    options.trial.time_limit_s = 30.0;
  }

  static TriangleMesh make_mesh() {
    TriangleMesh mesh = make_two_rooms();
    append_box(mesh, {5.3F, 2.4F, 0.0F}, {6.0F, 4.0F, 0.7F});
    return mesh;
  }
  static std::unique_ptr<core::Renderer> make_renderer() {
    return std::make_unique<BoxRenderer>(
        std::vector<LabelledBox>{{{5.3, 2.4, 0.0}, {6.0, 4.0, 0.7}, kCouch, 1},
                                 {{2.9, 0.0, 0.0}, {3.1, 2.6, 2.0}, kWall, 0}});
  }
  /// Looks at the gap between the rooms.
  [[nodiscard]] Episode episode(const core::Pose2& start = {1.0, 3.3, 0.0}) const {
    Episode made;
    made.id = "rooms/couch/00";
    made.class_name = "couch";
    made.start = start;
    made.view_points_m = {{4.7, 3.3}};
    made.shortest_path_m = world.distance_to(made.view_points_m).at({start.x_m, start.y_m});
    made.seed = 42;
    return made;
  }
  /// What a trial makes of those commands.
  [[nodiscard]] TrialResult trial(const Episode& task,
                                  const std::vector<core::VelocityCommand>& commands,
                                  bool stops) const {
    const auto renderer = make_renderer();
    OracleDetector detector(world.manifest().classes, {"couch"});
    PlaybackPolicy policy(commands, stops);
    return run_trial({.episode = task,
                      .options = options.trial,
                      .world = world,
                      .robot = world.robot(),
                      .renderer = *renderer,
                      .detector = detector,
                      .policy = policy,
                      .truth = &detector});
  }

  World world;
  EnvironmentOptions options;
};

}  // namespace segsim::sim
