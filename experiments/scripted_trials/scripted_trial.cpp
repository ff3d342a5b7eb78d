#include "experiments/scripted_trials/scripted_trial.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/scripted_trials/internal/script_reader.h"
#include "sim/ground/robot.h"

namespace segsim::experiments::scripted_trials {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;

constexpr double kDegree_rad = std::numbers::pi / 180.0;

core::GeodeticOrigin read_origin(const ConfigNode& node) {
  core::GeodeticOrigin origin;
  origin.latitude_deg = support::number_within(node, "latitude_deg", 0.0, -90.0, 90.0);
  origin.longitude_deg = support::number_within(node, "longitude_deg", 0.0, -180.0, 180.0);
  origin.height_m = support::number_within(node, "height_m", 0.0, -1000.0, 10000.0);
  origin.yaw_rad = support::number_within(node, "yaw_deg", 0.0, -360.0, 360.0) * kDegree_rad;
  node.finish();
  return origin;
}

ScriptScene read_scene(const ConfigNode& root, const script::Reader& reader) {
  ScriptScene scene;
  const ConfigNode node = root.child("scene");
  if (node.is_scalar()) {
    scene.bundle = reader.path(node);
    return scene;
  }
  const bool given = node.has("bundle");
  if (given == node.has("source")) node.fail("bundle or source", given ? "both" : "neither");
  if (given) scene.bundle = reader.path(node.child("bundle"));
  if (const auto source = node.optional_child("source")) {
    scene.source = specs::read_source_spec(*source, reader.folders, reader.file);
    if (scene.source->type == specs::SourceType::kRgbd) {
      source->fail("flat, gazebo or mesh (a recording must become a bundle first)", "rgbd");
    }
    if (const auto origin = node.optional_child("origin")) scene.origin = read_origin(*origin);
  }
  if (node.has("camera_height_m")) {
    scene.camera_height_m = support::number_within(node, "camera_height_m", 1.2, 0.05, 3.0);
  }
  node.finish();
  return scene;
}

void read_clock(const ConfigNode& root, const script::Reader& reader, ScriptedTrial& trial) {
  if (const auto node = root.optional_child("clock")) {
    const double control_hz = support::number_within(*node, "control_hz", 10.0, 0.1, 200.0);
    trial.control_period_s = 1.0 / control_hz;
    const double substeps = trial.control_period_s / sim::TrialOptions{}.substep_s;
    if (std::abs(substeps - std::round(substeps)) > 1e-9) {
      node->child("control_hz")
          .fail("a rate of 200 / n (the robot moves in steps of 5 ms)",
                node->text("control_hz"));
    }
  }
  trial.clock =
      specs::read_clock_spec(root, [&](const ConfigNode& path) { return reader.path(path); });
  specs::check_arm_clock(trial.clock, {}, root.has("clock") ? root.child("clock") : root);
}

void read_start(const ConfigNode& root, ScriptedTrial& trial) {
  const ConfigNode node = root.child("start");
  if (node.has("pose") == node.has("latlon")) {
    node.fail("pose: [x, y, yaw] or latlon with heading_deg",
              node.has("pose") ? "both" : "neither");
  }
  if (node.has("pose")) {
    const std::vector<double> pose = node.numbers("pose");
    if (pose.size() != 3) {
      node.child("pose").fail("[x, y, yaw] in metres and radians",
                              std::to_string(pose.size()) + " numbers");
    }
    trial.start = glm::dvec2(pose[0], pose[1]);
    trial.start_heading = pose[2];
  } else {
    trial.start = script::place_of(node.child("latlon"), node.numbers("latlon"), true);
    trial.start_heading =
        support::number_within(node, "heading_deg", 0.0, -360.0, 360.0) * kDegree_rad;
  }
  node.finish();
}

void read_latency_fault(const ConfigNode& node, double at_s, ScriptedTrial& trial) {
  sim::LatencyFault fault;
  std::vector<std::string> stages;
  if (trial.clock.budget) {
    for (const sim::StageBudget& stage : trial.clock.budget->budget.stages) {
      if (stage.charge == sim::Charge::kRobot) stages.push_back(stage.name);
    }
  } else if (trial.clock.mode != sim::ClockMode::kLockstep) {
    stages = {sim::to_string(sim::StageRole::kDetect),
              sim::to_string(sim::StageRole::kPolicy)};
  }
  if (stages.empty()) {
    node.fail("a clock in which stages take time (a budget)", "none");
  }
  fault.stage = stages[core::choice(node, "stage", stages)];
  (void)node.child("add_ms");
  const double add_ms = support::number_within(node, "add_ms", 0.0, 0.0, 60000.0);
  (void)node.child("for_s");
  const double for_s = support::number_within(node, "for_s", 0.0, 0.0, 36000.0);
  fault.from_ns = std::llround(at_s * 1e9);
  fault.until_ns = fault.from_ns + std::llround(for_s * 1e9);
  fault.added_ns = sim::ns_from_ms(add_ms);
  trial.fault_words.push_back(
      core::print("%s +%g ms for %g s", fault.stage.c_str(), add_ms, for_s));
  trial.faults.latencies.push_back(std::move(fault));
}

void read_faults(const ConfigNode& root, ScriptedTrial& trial) {
  for (const ConfigNode& node : root.list("faults")) {
    (void)node.child("at_s");
    const double at_s = support::number_within(node, "at_s", 0.0, 0.0, 36000.0);
    if (node.has("latency") == node.has("drop_frames")) {
      node.fail("latency or drop_frames", node.has("latency") ? "both" : "neither");
    }
    if (const auto latency = node.optional_child("latency")) {
      read_latency_fault(*latency, at_s, trial);
      latency->finish();
    } else {
      const ConfigNode drop = node.child("drop_frames");
      if (drop.has("camera")) (void)core::choice(drop, "camera", {"front"});
      (void)drop.child("count");
      const int count = static_cast<int>(support::number_within(drop, "count", 1.0, 1.0, 1e6));
      drop.finish();
      trial.faults.frame_drops.push_back({std::llround(at_s * 1e9), count});
      trial.fault_words.push_back(core::print("%d frames lost", count));
    }
    node.finish();
    trial.fault_times_s.push_back(at_s);
  }
}

/// A stage that the clock plays, or the whole chain.
std::string read_stage(const ConfigNode& node, const ScriptedTrial& trial) {
  std::vector<std::string> stages{"end_to_end", "e2e"};
  if (trial.clock.budget) {
    for (const sim::StageBudget& stage : trial.clock.budget->budget.stages) {
      if (stage.charge == sim::Charge::kRobot) stages.push_back(stage.name);
    }
  } else if (trial.clock.mode != sim::ClockMode::kLockstep) {
    stages.insert(stages.end(), {sim::to_string(sim::StageRole::kDetect),
                                 sim::to_string(sim::StageRole::kPolicy)});
  }
  const std::string stage = stages[core::choice(node, "stage", stages)];
  return stage == "e2e" ? "end_to_end" : stage;
}

void read_expectations(const ConfigNode& root, ScriptedTrial& trial) {
  for (const ConfigNode& node : root.list("expect")) {
    Expectation expectation;
    expectation.where = node.where();
    expectation.metric = metric_names()[core::choice(node, "metric", metric_names())];
    if (metric_needs_stage(expectation.metric)) expectation.stage = read_stage(node, trial);
    for (const auto& [key, bound] :
         {std::pair{"min", &expectation.min}, std::pair{"max", &expectation.max}}) {
      if (node.has(key)) *bound = node.number(key);
    }
    if (!expectation.min && !expectation.max) node.fail("min, max, or both", "neither");
    if (expectation.min && expectation.max && *expectation.min > *expectation.max) {
      node.child("max").fail("a number not below min", node.text("max"));
    }
    node.finish();
    trial.expectations.push_back(std::move(expectation));
  }
}

void read_record(const ConfigNode& root, ScriptedTrial& trial) {
  const auto node = root.optional_child("record");
  if (!node) return;
  if (node->has("ticks")) {
    trial.record.ticks = core::choice(*node, "ticks", {"none", "full"}) == 1;
  }
  trial.record.video = node->boolean_or("video", false);
  trial.record.topdown = node->boolean_or("topdown", true);
  trial.record.exr_every =
      static_cast<int>(support::number_within(*node, "exr_every", 0.0, 0.0, 1e6));
  node->finish();
}

}  // namespace

fs::path script::Reader::path(const ConfigNode& node) const {
  const fs::path expanded = specs::read_spec_path(node, folders, file);
  return expanded.is_absolute() ? expanded
                                : (file.parent_path() / expanded).lexically_normal();
}

Place script::place_of(const ConfigNode& node, const std::vector<double>& numbers,
                       bool latlon) {
  const bool finite = std::all_of(numbers.begin(), numbers.end(),
                                  [](double value) { return std::isfinite(value); });
  if (numbers.size() != 2 || !finite) {
    node.fail(latlon ? "[latitude, longitude] in degrees" : "[x, y] in metres",
              std::to_string(numbers.size()) + (finite ? " numbers" : " numbers, not finite"));
  }
  if (!latlon) return glm::dvec2(numbers[0], numbers[1]);
  if (std::abs(numbers[0]) > 90.0 || std::abs(numbers[1]) > 180.0) {
    node.fail("[latitude, longitude] in degrees",
              core::print("[%g, %g]", numbers[0], numbers[1]));
  }
  return sim::GeodeticPoint{numbers[0], numbers[1], 0.0};
}

Place script::read_place(const ConfigNode& node) {
  if (node.has("xy") == node.has("latlon")) {
    node.fail("xy or latlon", node.has("xy") ? "both" : "neither");
  }
  const char* const key = node.has("xy") ? "xy" : "latlon";
  return place_of(node.child(key), node.numbers(key), key[0] == 'l');
}

const std::vector<std::string>& metric_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> made{"collisions",     "contact_s",          "path_m",
                                  "time_s",         "distance_to_goal_m", "max_speed_mps",
                                  "path_error_m",   "steps_done",         "finds",
                                  "frames_dropped", "ticks_without_news"};
    for (const char* share : {"p50", "p95", "p99", "max"}) {
      made.push_back(std::string("obs_age_ms.") + share);
    }
    for (const char* share : {"p50", "p95", "p99", "max"}) {
      made.push_back(std::string("stage_ms.") + share);
    }
    made.insert(made.end(), {"deadline_miss_rate", "longest_miss_run", "stage_drops"});
    return made;
  }();
  return names;
}

bool metric_needs_stage(const std::string& metric) {
  return metric.starts_with("stage_") || metric == "deadline_miss_rate" ||
         metric == "longest_miss_run";
}

ScriptedTrial load_scripted_trial(const fs::path& file, const fs::path& data) {
  return parse_scripted_trial(core::read_file(file), file, data);
}

ScriptedTrial parse_scripted_trial(const std::string& text, const fs::path& origin,
                                   const fs::path& data) {
  const ConfigNode root = ConfigNode::parse(text, origin.string());
  (void)core::choice(root, "schema", {ScriptedTrial::kSchema});
  const script::Reader reader{origin, {data, {}}};
  ScriptedTrial trial;
  trial.file = origin;
  trial.name = origin.stem().string();
  trial.title = root.text_or("title", trial.name);
  trial.scene = read_scene(root, reader);
  if (root.has("robot")) {
    trial.robot = sim::RobotModel::read(
        root.child("robot"), [&](const ConfigNode& node) { return reader.path(node); });
  }
  read_clock(root, reader, trial);
  trial.time_limit_s =
      support::number_within(root, "time_limit_s", trial.time_limit_s, 0.1, 36000.0);
  trial.seed = static_cast<std::uint64_t>(
      support::number_within(root, "seed", static_cast<double>(trial.seed), 0.0, 9e15));
  read_start(root, trial);
  trial.camera = specs::read_camera_spec(root);
  if (root.has("detector") && root.text("detector") != "oracle") {
    trial.weights = reader.path(root.child("detector"));
  }
  trial.localisation = specs::read_localisation(root);
  trial.sensors = specs::read_sensors(root);
  if (root.has("contact")) {
    trial.slide_on_contact = core::choice(root, "contact", {"stop", "slide"}) == 1;
  }
  trial.collision = specs::read_collision_mode(root);
  trial.steps = script::read_steps(root, reader);
  read_faults(root, trial);
  read_expectations(root, trial);
  read_record(root, trial);
  root.finish();
  return trial;
}

}  // namespace segsim::experiments::scripted_trials
