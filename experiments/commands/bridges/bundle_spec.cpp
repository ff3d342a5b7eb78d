#include "experiments/commands/bridges/bundle_spec.h"

#include <algorithm>
#include <cmath>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/suites/layered_yaml.h"
#include "experiments/support/listed.h"
#include "sim/trial/thing_names.h"

namespace segsim::experiments::commands::bridges {
namespace {

namespace fs = std::filesystem;

std::string detector_text(const std::string& detector) {
  const bool truth = detector == "none" || detector == "oracle";
  return truth ? "oracle" : suites::yaml_scalar(fs::absolute(detector).string());
}

}  // namespace

std::string BundleSpec::text(const core::SceneManifest& scene) const {
  std::string text =
      "schema: segsim.experiment/1\nname: " + arm + "\nseed: " + std::to_string(seed) +
      "\nscenes:\n  - name: scene\n    title: " + suites::yaml_scalar(scene.name) +
      "\n    bundle: " + suites::yaml_scalar(fs::absolute(bundle).string()) + "\n    goals: [";
  for (std::size_t i = 0; i < goals.size(); ++i) {
    text += (i > 0 ? ", " : "") + suites::yaml_scalar(goals[i]);
  }
  text += "]\n    episodes: " + std::to_string(episodes) + "\n";
  if (any_start) {
    text +=
        "    start_distance_m: [0.5, 1000]\n    allow_visible_start: true\n    allow_trivial: "
        "true\n";
  }
  const double height_m = camera_height_m > 0.0 ? camera_height_m : scene.camera_height_m;
  if (height_m > 0.0) text += core::print("    camera_height_m: %g\n", height_m);
  text += "arms:\n  - {name: " + arm + ", detector: " + detector_text(detector) +
          "}\nrobot: " + suites::yaml_scalar(robot) + "\n";
  if (!sensors.empty()) {
    text += "sensors:\n";
    for (const std::string& name : sensors) text += "  " + name + ": {}\n";
  }
  text += core::print("control_period_s: %.9g\ntime_limit_s: %g\n", 1.0 / rate_hz, limit_s);
  text += core::print(
      "camera: {width: %d, height: %d, hfov_deg: %g, pitch_down_deg: %g, depth_range_m: %g",
      width_px, height_px, hfov_deg, pitch_down_deg, depth_range_m);
  return text + ", backend: " + backend + "}\n";
}

void BundleSpec::check(const core::SceneManifest& scene) const {
  const double steps = 200.0 / rate_hz;
  if (std::abs(steps - std::round(steps)) > 1e-6) {
    throw core::InputError::expected("--rate", "200 divided by a whole number",
                                     core::print("%g", rate_hz));
  }
  const std::vector<std::string> known = sim::thing_names(scene.classes);
  for (const std::string& goal : goals) {
    if (std::find(known.begin(), known.end(), goal) == known.end()) {
      throw core::InputError::expected("--goal", support::listed(known), "\"" + goal + "\"");
    }
  }
}

void add_bundle_flags(CLI::App& command, BundleSpec& spec) {
  command.add_option("--seed", spec.seed, "Of the start and of the sensors' errors")
      ->capture_default_str();
  command.add_option("--robot", spec.robot, "Size and limits (see `segsim robots`)")
      ->capture_default_str();
  command.add_option("--time-limit", spec.limit_s, "Simulated seconds")
      ->check(CLI::Range(1.0, 100000.0))
      ->capture_default_str();
  command
      .add_option("--rate", spec.rate_hz,
                  "Images and commands a second: 200 divided by a whole number")
      ->check(CLI::Range(1.0, 100.0))
      ->capture_default_str();
  command.add_option("--width", spec.width_px, "Image width [px]")
      ->check(light::image_side())
      ->capture_default_str();
  command.add_option("--height", spec.height_px, "Image height [px]")
      ->check(light::image_side())
      ->capture_default_str();
  command.add_option("--hfov-deg", spec.hfov_deg, "Horizontal field of view [degrees]")
      ->check(light::field_of_view_deg())
      ->capture_default_str();
  command.add_option("--pitch-down-deg", spec.pitch_down_deg, "Of the camera [degrees]")
      ->check(CLI::Range(-60.0, 60.0))
      ->capture_default_str();
  command.add_option("--depth-range", spec.depth_range_m, "Of the depth camera [m]")
      ->check(CLI::Range(0.5, 100.0))
      ->capture_default_str();
  command
      .add_option("--camera-height", spec.camera_height_m,
                  "Above the floor [m]; 0 = the bundle's, or the robot's")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  command.add_option("--backend", spec.backend, "cpu | cuda | auto")
      ->check(CLI::IsMember({"cpu", "cuda", "auto"}))
      ->capture_default_str();
}

}  // namespace segsim::experiments::commands::bridges
