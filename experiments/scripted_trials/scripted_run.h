#pragma once

/// @file
/// Drives a scripted trial and judges it.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/scripted_trials/script_driver.h"
#include "experiments/scripted_trials/scripted_trial.h"
#include "sim/ground/world.h"
#include "sim/trial/trial.h"
#include "worlds/mesh/texture_reader.h"

namespace segsim::experiments::scripted_trials {

/// The scene of a script in memory, with every place in World.
struct BoundScript {
  const ScriptedTrial* script = nullptr;
  core::SceneBundle bundle;  ///< Of a world of meshes: a manifest without files.
  sim::World world;
  std::unique_ptr<core::Renderer> renderer;
  drawing::FloorPlan plan;
  double camera_height_m = 1.2;
  core::Pose2 start;
  std::vector<std::vector<glm::dvec2>> places_m;  ///< Of each step.
};

/// Loads the scene and checks the script against it: the start is free, every goto leads to a
/// place that the robot can reach from there, categories are searched for that the scene has.
/// @param script  Outlives the result.
/// @param textures  Of a world of meshes.
/// @throws core::InputError naming the line of the script.
[[nodiscard]] BoundScript bind_script(
    const ScriptedTrial& script,
    const worlds::TextureReader& textures = worlds::image_textures());
/// The same checks. Of a world of meshes nothing is made that draws.
void check_script(const ScriptedTrial& script);

/// How a kFind step ended, by its profile.
struct FindResult {
  int step = 0;
  bool success = false;
  double view_point_m = 0.0;  ///< Geodesic; infinity if there is no way.
  int visible_px = 0;         ///< Of the goal object seen best.
  double path_m = 0.0, shortest_path_m = 0.0, spl = 0.0;
  std::optional<core::StopReason> stop;  ///< Why the policy stopped.
};

struct ExpectationResult {
  const Expectation* expectation = nullptr;
  std::optional<double> value;  ///< None: the trial has no such number.
  bool holds = false;
};

struct ScriptedResult {
  sim::TrialResult trial;
  std::vector<StepOutcome> steps;
  std::vector<FindResult> finds;
  std::vector<ExpectationResult> verdicts;
  double distance_to_goal_m = 0.0;  ///< Geodesic, to the place of the last step that has one.
  double max_speed_mps = 0.0;       ///< From tick to tick.
  std::optional<double> path_error_m;  ///< Largest distance from the path of a kFollow step.
  int steps_done = 0;
  std::string failure;  ///< Why not all steps were done; empty if they were.

  /// All steps done and all expectations met.
  [[nodiscard]] bool passed() const;
};

/// @param folder  For what the script records; it is made.
/// @throws core::InputError if a file cannot be written or weights cannot be read.
[[nodiscard]] ScriptedResult run_script(BoundScript& bound,
                                        const std::filesystem::path& folder);

/// For people, one line per step, fault, and expectation.
[[nodiscard]] std::string in_words(const ScriptedTrial& script, const ScriptedResult& result);
/// Everything as JSON.
[[nodiscard]] std::string to_json(const ScriptedTrial& script, const ScriptedResult& result);

/// The drive from above: steps, faults and contacts marked.
[[nodiscard]] core::Image<core::Rgb8> draw_script(const BoundScript& bound,
                                                  const ScriptedResult& result,
                                                  int long_side_px = 1000);

}  // namespace segsim::experiments::scripted_trials
