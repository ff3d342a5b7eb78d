// From a script's scene to what its drive needs in memory.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/reproducibility/backend_warning.h"
#include "experiments/scenes/mesh_floor_plan.h"
#include "experiments/scenes/mesh_source.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/scripted_trials/scripted_run.h"
#include "renderer/renderer_backend.h"
#include "sim/trial/oracle_way.h"
#include "sim/trial/thing_names.h"
#include "worlds/capture/mesh_renderer.h"
#include "worlds/mesh/plain_mesh.h"

namespace segsim::experiments::scripted_trials {
namespace {

/// Nobody looks at the colours: they are black, and cost nothing.
class ColourlessRenderer final : public core::Renderer {
 public:
  explicit ColourlessRenderer(std::unique_ptr<core::Renderer> inner)
      : inner_(std::move(inner)) {}
  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels channels, core::Frame& frame) override {
    const auto without =
        static_cast<core::Channels>(static_cast<std::uint32_t>(channels) &
                                    ~static_cast<std::uint32_t>(core::Channels::kRgb));
    inner_->render(T_world_camera, intrinsics, without, frame);
    frame.rgb.resize(intrinsics.width_px, intrinsics.height_px);
  }

 private:
  std::unique_ptr<core::Renderer> inner_;
};

/// The collision world has no use for what is above every robot, and a ceiling hides the floor
/// from the navigation mesh.
sim::TriangleMesh without_ceiling(sim::TriangleMesh mesh) {
  constexpr float kCeiling_m = 2.2F;
  std::erase_if(mesh.triangles, [&](const glm::uvec3& t) {
    return std::min({mesh.positions_m[t.x].z, mesh.positions_m[t.y].z,
                     mesh.positions_m[t.z].z}) > kCeiling_m;
  });
  return mesh;
}

/// @param drawn  False: without what draws.
BoundScript load_meshes(const ScriptedTrial& script, const sim::RobotModel& robot,
                        const worlds::TextureReader& textures, bool drawn) {
  const sim::MeshScene scene = scenes::load_mesh_source(*script.scene.source, textures);
  core::SceneBundle bundle;
  bundle.manifest.name = scene.name;
  bundle.manifest.source = scene.source;
  bundle.manifest.origin = script.scene.origin;
  bundle.manifest.camera_height_m = robot.camera_height_m;
  bundle.manifest.classes = scene.classes;
  bundle.manifest.instances = scene.instances;
  sim::World world = sim::World::from_mesh(without_ceiling(worlds::plain_mesh(scene)), robot,
                                           script.scene.origin);
  world.set_manifest(bundle.manifest);
  worlds::MeshRenderOptions options;
  // Shadows that are a little softer fill the cache five times as fast.
  options.cell_m = 0.08F;
  options.bounce_samples = 49;
  if (!script.needs_colour()) options.exposure = 1.0F;
  drawing::FloorPlan plan;
  std::unique_ptr<core::Renderer> renderer;
  if (drawn) {
    plan = scenes::make_mesh_floor_plan(scene, world);
    renderer = worlds::make_mesh_renderer(scene, options);
  }
  return {&script,
          std::move(bundle),
          std::move(world),
          std::move(renderer),
          std::move(plan),
          0.0,
          {},
          {}};
}

BoundScript load_reconstruction(const ScriptedTrial& script, const sim::RobotModel& robot) {
  core::SceneBundle bundle = core::load_bundle(script.scene.bundle);
  sim::World world = sim::World::load(bundle, robot);
  auto [surfels, labels] = scenes::load_scene_surfels(bundle);
  auto renderer = renderer::make_renderer(script.camera.backend, surfels, {}, labels,
                                          reproducibility::warn_about_backend);
  drawing::FloorPlan plan = drawing::make_floor_plan(*surfels);
  return {&script,
          std::move(bundle),
          std::move(world),
          std::move(renderer),
          std::move(plan),
          0.0,
          {},
          {}};
}

glm::dvec2 in_world(const Place& place, const sim::LocalFrame& frame) {
  if (const auto* p_m = std::get_if<glm::dvec2>(&place)) return *p_m;
  sim::GeodeticPoint point = std::get<sim::GeodeticPoint>(place);
  // The height is that of the floor, whatever a map program wrote.
  point.height_m = frame.origin().height_m;
  return glm::dvec2(frame.from_geodetic(point));
}

core::Pose2 start_of(const ScriptedTrial& script, const sim::LocalFrame& frame) {
  const glm::dvec2 p_m = in_world(script.start, frame);
  double yaw_rad = script.start_heading;
  if (std::holds_alternative<sim::GeodeticPoint>(script.start)) {
    // Clockwise from north to counter-clockwise from the world's x axis: east is at
    // x cos(yaw) - y sin(yaw), so the axis itself points to yaw from east.
    yaw_rad = 0.5 * std::numbers::pi - script.start_heading - frame.origin().yaw_rad;
  }
  return {p_m.x, p_m.y, core::wrap_angle_rad(yaw_rad)};
}

/// Every goto, from where the robot comes by then.
void check_ways(const BoundScript& bound) {
  for (std::size_t k = 0; k < bound.places_m.size(); ++k) {
    const ScriptStep& step = bound.script->steps[k];
    if (step.kind != StepKind::kGoto) continue;
    const glm::dvec2 goal_m = bound.places_m[k].front();
    const sim::OracleWay way(bound.world, bound.places_m[k]);
    if (way.from({bound.start.x_m, bound.start.y_m}).empty()) {
      throw core::InputError::expected(
          step.where, "a place that " + bound.world.robot().name + " can reach from its start",
          core::print("(%.2f, %.2f), where it cannot get", goal_m.x, goal_m.y));
    }
  }
}

void check_categories(const BoundScript& bound) {
  const std::vector<std::string> names = sim::thing_names(bound.bundle.manifest.classes);
  for (const ScriptStep& step : bound.script->steps) {
    if (step.kind != StepKind::kFind) continue;
    if (std::find(names.begin(), names.end(), step.category) != names.end()) continue;
    const std::string near = core::nearest_word(step.category, names);
    throw core::InputError::expected(
        step.where, "a category of the scene",
        "\"" + step.category + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
  }
}

BoundScript bind(const ScriptedTrial& script, const worlds::TextureReader& textures,
                 bool drawn) {
  const sim::RobotModel& robot = script.robot;
  BoundScript bound = script.scene.source ? load_meshes(script, robot, textures, drawn)
                                          : load_reconstruction(script, robot);
  if (bound.renderer && !script.needs_colour()) {
    bound.renderer = std::make_unique<ColourlessRenderer>(std::move(bound.renderer));
  }
  const double own_m = bound.bundle.manifest.camera_height_m;
  bound.camera_height_m = script.scene.camera_height_m > 0.0 ? script.scene.camera_height_m
                          : own_m > 0.0                      ? own_m
                                                             : robot.camera_height_m;
  const sim::LocalFrame& frame = bound.world.local_frame();
  bound.start = start_of(script, frame);
  for (const ScriptStep& step : script.steps) {
    std::vector<glm::dvec2> places_m;
    for (const Place& place : step.places) places_m.push_back(in_world(place, frame));
    bound.places_m.push_back(std::move(places_m));
  }
  if (script.collision == sim::CollisionMode::kFootprint &&
      bound.world.collision().collides(bound.start)) {
    throw core::InputError::expected(script.file.string() + ": start",
                                     "a place where " + robot.name + " fits",
                                     core::print("(%.2f, %.2f), where it touches something",
                                                 bound.start.x_m, bound.start.y_m));
  }
  check_ways(bound);
  check_categories(bound);
  return bound;
}

}  // namespace

BoundScript bind_script(const ScriptedTrial& script, const worlds::TextureReader& textures) {
  return bind(script, textures, true);
}

void check_script(const ScriptedTrial& script) {
  (void)bind(script, worlds::blank_textures(), false);
}

}  // namespace segsim::experiments::scripted_trials
