#pragma once

/// @file
/// A drive that somebody wrote down: where to, what goes wrong on the way, and what must hold
/// in the end (docs/trials.md; experiments/trials/ has complete examples).
///
///     schema: segsim.trial/1
///     scene: {source: {type: flat, seed: 3}}       # or the folder of a bundle
///     robot: jackal-gentle
///     clock: {mode: virtual, control_hz: 20, budget: ../budgets/example-edge.yaml}
///     start: {pose: [0.5, -1.2, 0.0]}              # or {latlon: [..], heading_deg: ..}
///     steps:
///       - goto: {xy: [3.0, 2.0], tolerance: 0.25, timeout_s: 40}
///       - spin: {deg: 360, rate: 0.8}
///     faults:
///       - {at_s: 5.0, latency: {stage: detect, add_ms: 200, for_s: 3.0}}
///     expect:
///       - {metric: collisions, max: 0}
///     record: {ticks: full, topdown: true}

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <glm/vec2.hpp>

#include "core/frames.h"
#include "experiments/specs/clock_spec.h"
#include "experiments/specs/sensor_spec.h"
#include "experiments/specs/spec.h"
#include "nav/policies/policy_registry.h"
#include "sim/ground/geodesy.h"
#include "sim/trial/success_profile.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::scripted_trials {

/// In World, or on the globe.
using Place = std::variant<glm::dvec2, sim::GeodeticPoint>;

enum class StepKind : std::uint8_t { kGoto, kFollow, kSpin, kCmd, kHold, kFind };
[[nodiscard]] const char* to_string(StepKind kind);

struct ScriptStep {
  StepKind kind = StepKind::kHold;
  std::string where;              ///< "file:line: steps[2].goto", for messages.
  std::vector<Place> places;      ///< kGoto: one; kFollow: the path's corners, two or more.
  double tolerance_m = 0.25;      ///< kGoto, kFollow: this near to the end it is done.
  double speed_mps = 0.5;         ///< kGoto, kFollow.
  double angle_rad = 0.0;         ///< kSpin; positive turns left.
  double rate_radps = 0.8;        ///< kSpin.
  core::VelocityCommand command;  ///< kCmd.
  double for_s = 0.0;             ///< kCmd, kHold.
  double timeout_s = 0.0;         ///< Of all others; 0: none of its own.
  // kFind
  std::string category;
  nav::PolicyChoice policy = nav::PolicyRegistry::instance().usual("frontier");
  sim::SuccessProfile profile;
  int max_steps = 500;  ///< Decisions.
};

/// A number of the trial and what it may be.
struct Expectation {
  std::string where;
  std::string metric;  ///< One of metric_names(), percentile included: "obs_age_ms.p95".
  std::string
      stage;  ///< Of metrics about a stage; "end_to_end" (or "e2e") for the whole chain.
  std::optional<double> min, max;  ///< One of them at least; both bounds are allowed values.
};

struct ScriptRecord {
  bool ticks = false;   ///< Every tick into ticks.csv.
  bool topdown = true;  ///< A picture.
  bool video = false;
  int exr_every = 0;  ///< An OpenEXR file every so many ticks; 0: none.
};

/// A bundle's folder, or a world of meshes that is driven in as it is.
struct ScriptScene {
  std::filesystem::path bundle;
  std::optional<specs::SourceSpec> source;
  core::GeodeticOrigin origin;   ///< Of `source`; a bundle has its own.
  double camera_height_m = 0.0;  ///< 0: the bundle's, or the robot's.
};

struct ScriptedTrial {
  static constexpr const char* kSchema = "segsim.trial/1";

  std::string name;  ///< Of the file, without ending.
  std::string title;
  ScriptScene scene;
  sim::RobotModel robot = sim::RobotModel::jackal_gentle();
  specs::ClockSpec clock;
  double control_period_s = 0.1;
  double time_limit_s = 600.0;
  std::uint64_t seed = 1;
  Place start = glm::dvec2(0.0);
  double start_heading = 0.0;  ///< Yaw [rad]; of a start by latitude and longitude the heading
                               ///< from north, clockwise [rad].
  specs::CameraSpec camera;
  std::filesystem::path weights;  ///< Of the detector; empty: the oracle.
  specs::LocalisationSpec localisation;
  std::optional<sim::SensorSettings> sensors;  ///< None: an exact camera alone.
  bool slide_on_contact = false;
  sim::CollisionMode collision = sim::CollisionMode::kFootprint;
  std::vector<ScriptStep> steps;
  sim::TrialFaults faults;
  std::vector<std::string> fault_words;  ///< One line each, in the order of the file.
  std::vector<double> fault_times_s;     ///< Of these.
  std::vector<Expectation> expectations;
  ScriptRecord record;
  std::filesystem::path file;

  /// Whether anything looks at colours.
  [[nodiscard]] bool needs_colour() const {
    return record.video || record.exr_every > 0 || !weights.empty();
  }
};

/// Metrics that an expectation may name; those about a stage end in "(stage)".
[[nodiscard]] const std::vector<std::string>& metric_names();
/// Whether the metric is of a stage.
[[nodiscard]] bool metric_needs_stage(const std::string& metric);

/// Reads and checks a file. Paths in it are relative to its folder; ${data} is `data`.
/// @throws core::InputError with file, line and key.
[[nodiscard]] ScriptedTrial load_scripted_trial(const std::filesystem::path& file,
                                                const std::filesystem::path& data);
[[nodiscard]] ScriptedTrial parse_scripted_trial(const std::string& text,
                                                 const std::filesystem::path& origin,
                                                 const std::filesystem::path& data);

}  // namespace segsim::experiments::scripted_trials
