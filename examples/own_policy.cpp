// A policy of one's own, in about 40 lines, and a trial that judges it.
//
//     own_policy
//
// The policy sees images and detections and answers with a velocity. It drives towards the
// goal when it detects it, stops in front of it, and turns away from whatever stands in its
// way. The trial puts it into a furnished room and lets it look for the couch. Writes
// last_view.ppm, what the robot's camera saw last, into the current folder.

#include <algorithm>
#include <cmath>
#include <iostream>

#include "core/error.h"
#include "examples/picture.h"
#include "sim/trial/oracle_detector.h"
#include "sim/trial/trial.h"
#include "worlds/capture/mesh_renderer.h"
#include "worlds/mesh/mesh_builder.h"
#include "worlds/mesh/plain_mesh.h"

using namespace segsim;

namespace {

class TurnAwayPolicy final : public core::Policy {
 public:
  void reset(const core::ObjectGoal& goal, std::uint64_t /*seed*/) override { goal_ = goal; }

  core::Decision decide(const core::Observation& seen,
                        std::span<const core::Detection> detections) override {
    const double free_m = free_ahead_m(seen);
    core::Decision explore;
    (free_m > 1.0 ? explore.command.forward_mps : explore.command.turn_radps) = 0.6;
    for (const core::Detection& detection : detections) {
      if (detection.class_index != goal_.class_index) continue;
      const double x_px = 0.5 * (detection.box.x0 + detection.box.x1);
      const double left_rad =
          std::atan((seen.intrinsics.cx_px - x_px) / seen.intrinsics.fx_px);
      if (std::abs(left_rad) < 0.2 && free_m < 0.7) {
        return {{}, core::PolicyMode::kStop, core::StopReason::kGoalReached};
      }
      return {
          {std::abs(left_rad) < 0.2 ? 0.4 : 0.0, left_rad}, core::PolicyMode::kNavigate, {}};
    }
    return explore;
  }

  core::PolicyView view() const override { return {}; }  // It keeps no map.

 private:
  /// How far the robot can drive straight on before something higher than a sill is in its
  /// way.
  static double free_ahead_m(const core::Observation& seen) {
    double nearest_m = 10.0;
    for (int y = 0; y < seen.depth_m->height_px(); ++y) {
      for (int x = 0; x < seen.depth_m->width_px(); ++x) {
        const core::Point<core::frame::Camera> p_camera{
            seen.intrinsics.back_project({x + 0.5, y + 0.5}, (*seen.depth_m)(x, y))};
        const glm::dvec3 p_robot_m = (seen.T_robot_camera * p_camera).xyz_m;
        // Where nothing was measured the depth is NaN, and every comparison is false.
        const bool in_the_way = std::abs(p_robot_m.y) < 0.35 && p_robot_m.z > 0.1;
        if (in_the_way) nearest_m = std::min(nearest_m, p_robot_m.x);
      }
    }
    return nearest_m;
  }

  core::ObjectGoal goal_;
};

constexpr std::uint16_t kWallClass = 1, kTableClass = 2, kCouchClass = 3;

/// A room of 6 m x 5 m with a table, and a couch at its far wall.
sim::MeshScene make_room() {
  sim::MeshScene room;
  room.classes = {{kWallClass, "wall", false},
                  {kTableClass, "dining table", true},
                  {kCouchClass, "couch", true}};
  room.materials = {{.albedo = {0.6F, 0.6F, 0.55F}},
                    {.albedo = {0.5F, 0.3F, 0.1F}},
                    {.albedo = {0.1F, 0.2F, 0.6F}}};
  room.lights = {{.position_m = {3.0F, 2.5F, 2.4F}, .radiance = glm::vec3(8.0F)}};
  const auto add_box = [&room](const glm::vec3& center_m, const glm::vec3& size_m,
                               int material, std::uint16_t class_id,
                               std::uint16_t instance_id) {
    worlds::MeshBuilder builder;
    builder.set_surface({.material = material});
    builder.add_box(center_m, size_m);
    for (sim::SubMesh& mesh : builder.build(glm::mat4(1.0F), class_id, instance_id)) {
      room.meshes.push_back(std::move(mesh));
    }
    if (instance_id == 0) return;
    room.instances.push_back({instance_id, class_id,
                              class_id == kCouchClass ? "couch" : "table",
                              center_m - 0.5F * size_m, center_m + 0.5F * size_m});
  };
  add_box({3.0F, 2.5F, -0.1F}, {6.4F, 5.4F, 0.2F}, 0, kWallClass,
          0);  // The floor's top is z = 0.
  add_box({-0.1F, 2.5F, 1.3F}, {0.2F, 5.4F, 2.6F}, 0, kWallClass, 0);
  add_box({6.1F, 2.5F, 1.3F}, {0.2F, 5.4F, 2.6F}, 0, kWallClass, 0);
  add_box({3.0F, -0.1F, 1.3F}, {6.0F, 0.2F, 2.6F}, 0, kWallClass, 0);
  add_box({3.0F, 5.1F, 1.3F}, {6.0F, 0.2F, 2.6F}, 0, kWallClass, 0);
  add_box({3.2F, 1.6F, 0.4F}, {0.9F, 1.4F, 0.8F}, 1, kTableClass, 1);
  add_box({1.2F, 4.5F, 0.4F}, {1.8F, 0.8F, 0.8F}, 2, kCouchClass, 2);
  return room;
}

}  // namespace

int main() try {
  const sim::MeshScene room = make_room();
  const sim::RobotModel robot = sim::RobotModel::jackal_gentle();
  sim::World world = sim::World::from_mesh(worlds::plain_mesh(room), robot);
  core::SceneManifest manifest;
  manifest.classes = room.classes;
  manifest.instances = room.instances;
  world.set_manifest(manifest);

  sim::Episode episode;
  episode.id = "room/couch/0";
  episode.class_name = "couch";
  episode.start = {1.0, 1.0, 0.0};
  episode.view_points_m = {{1.2, 3.6}};
  episode.shortest_path_m =
      world.distance_to(episode.view_points_m).at({episode.start.x_m, episode.start.y_m});

  sim::TrialOptions options;
  options.camera = core::CameraIntrinsics::from_fov(160, 120, 1.2);
  options.camera_pitch_down_rad = 0.45;
  options.time_limit_s = 120.0;

  const auto camera = worlds::make_mesh_renderer(room, {.samples_per_side = 1});
  sim::OracleDetector detector(room.classes, {"couch"});
  TurnAwayPolicy policy;
  core::Image<core::Rgb8> last_view;
  const sim::TrialResult result = sim::run_trial(
      {.episode = episode,
       .options = options,
       .world = world,
       .robot = robot,
       .renderer = *camera,
       .detector = detector,
       .policy = policy,
       .truth = &detector,
       .observer = [&last_view](const sim::TickRecord&, const core::Frame& frame, const auto&,
                                const auto&) { last_view = frame.rgb; }});

  examples::write_ppm("last_view.ppm", last_view);
  std::cout << "outcome " << to_string(result.outcome) << "\nsimulated_s " << result.sim_s
            << "\npath_m " << result.path_m << "\nshortest_path_m " << result.shortest_path_m
            << "\nspl " << result.spl << "\ncontacts " << result.contacts << "\ngoal_pixels "
            << result.final_goal_pixels << '\n';
  return 0;
} catch (const core::InputError& error) {
  std::cerr << "error: " << error.what() << '\n';
  return 2;
}
