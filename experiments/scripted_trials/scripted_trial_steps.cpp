// The list `steps:` of a scripted trial.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/error.h"
#include "experiments/scripted_trials/geo_path.h"
#include "experiments/scripted_trials/internal/script_reader.h"

namespace segsim::experiments::scripted_trials {
namespace {

using core::ConfigNode;

constexpr std::array<const char*, 6> kKinds{"goto", "follow", "spin", "cmd", "hold", "find"};
constexpr double kLongest_s = 36000.0;

std::vector<std::string> kind_names() { return {kKinds.begin(), kKinds.end()}; }

std::vector<Place> read_corners(const ConfigNode& list, bool latlon) {
  std::vector<Place> places;
  for (const ConfigNode& corner : list.as_list()) {
    std::vector<double> numbers;
    for (const ConfigNode& number : corner.as_list()) numbers.push_back(number.as_number());
    places.push_back(script::place_of(corner, numbers, latlon));
  }
  if (places.size() < 2) {
    list.fail("two corners or more", std::to_string(places.size()));
  }
  return places;
}

/// `path: FILE.geojson`, `xy: [[x, y], ...]` or `latlon: [[latitude, longitude], ...]`.
std::vector<Place> read_path(const ConfigNode& node, const script::Reader& reader) {
  const int given =
      (node.has("path") ? 1 : 0) + (node.has("xy") ? 1 : 0) + (node.has("latlon") ? 1 : 0);
  if (given != 1) {
    node.fail("one of path (GeoJSON), xy and latlon", std::to_string(given) + " of them");
  }
  if (node.has("xy")) return read_corners(node.child("xy"), false);
  if (node.has("latlon")) return read_corners(node.child("latlon"), true);
  std::vector<Place> places;
  try {
    for (const sim::GeodeticPoint& point :
         read_geojson_path(reader.path(node.child("path")))) {
      places.emplace_back(point);
    }
  } catch (const core::InputError& error) {
    throw core::InputError(node.child("path").where() + ": " + error.what());
  }
  return places;
}

void read_drive(const ConfigNode& node, ScriptStep& step) {
  step.tolerance_m = support::number_within(node, "tolerance", step.tolerance_m, 0.02, 5.0);
  step.speed_mps = support::number_within(node, "speed", step.speed_mps, 0.05, 10.0);
}

void read_find(const ConfigNode& node, const script::Reader& reader, ScriptStep& step) {
  step.category = node.text("category");
  if (node.has("policy")) {
    step.policy = nav::PolicyRegistry::instance().read(
        node.child("policy"), [&](const ConfigNode& path) { return reader.path(path); });
  }
  std::vector<std::string> names;
  for (const sim::SuccessProfile& profile : sim::success_profiles()) {
    // The others need what a scripted trial does not keep.
    const bool judged = profile.rule == sim::SuccessRule::kViewPoint ||
                        profile.rule == sim::SuccessRule::kInView;
    if (judged) names.push_back(profile.name);
  }
  if (node.has("profile")) {
    step.profile = *sim::find_success_profile(names[core::choice(node, "profile", names)]);
  }
  step.max_steps =
      static_cast<int>(support::number_within(node, "max_steps", step.max_steps, 1.0, 1e6));
}

void read_body(const ConfigNode& node, const script::Reader& reader, ScriptStep& step) {
  switch (step.kind) {
    case StepKind::kGoto:
      step.places = {script::read_place(node)};
      read_drive(node, step);
      break;
    case StepKind::kFollow:
      step.places = read_path(node, reader);
      read_drive(node, step);
      break;
    case StepKind::kSpin: {
      step.angle_rad = support::number_within(node, "deg", 360.0, -36000.0, 36000.0) *
                       std::numbers::pi / 180.0;
      step.rate_radps = support::number_within(node, "rate", step.rate_radps, 0.05, 10.0);
      break;
    }
    case StepKind::kCmd:
      step.command.forward_mps = support::number_within(node, "v", 0.0, -10.0, 10.0);
      step.command.turn_radps = support::number_within(node, "w", 0.0, -10.0, 10.0);
      [[fallthrough]];
    case StepKind::kHold:
      (void)node.child("for_s");
      step.for_s = support::number_within(node, "for_s", 0.0, 0.0, kLongest_s);
      return;  // They end by themselves.
    case StepKind::kFind:
      read_find(node, reader, step);
      break;
  }
  const double usual_s = step.kind == StepKind::kGoto   ? 60.0
                         : step.kind == StepKind::kFind ? 600.0
                                                        : 0.0;
  step.timeout_s = support::number_within(node, "timeout_s", usual_s, 0.0, kLongest_s);
}

}  // namespace

const char* to_string(StepKind kind) { return kKinds[static_cast<std::size_t>(kind)]; }

std::vector<ScriptStep> script::read_steps(const ConfigNode& root, const Reader& reader) {
  std::vector<ScriptStep> steps;
  for (const ConfigNode& node : root.list("steps")) {
    const std::vector<std::string> keys =
        node.is_map() ? node.keys() : std::vector<std::string>{};
    if (keys.size() != 1) {
      node.fail("one of goto, follow, spin, cmd, hold, find with its settings",
                keys.empty() ? "none" : std::to_string(keys.size()) + " keys");
    }
    ScriptStep step;
    step.kind = static_cast<StepKind>(core::one_of(node, keys[0], kind_names()));
    const ConfigNode body = node.child(keys[0]);
    step.where = body.where();
    read_body(body, reader, step);
    body.finish();
    steps.push_back(std::move(step));
  }
  if (steps.empty()) root.child("steps").fail("one step or more", "none");
  return steps;
}

}  // namespace segsim::experiments::scripted_trials
