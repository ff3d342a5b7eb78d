#pragma once

/// @file
/// An experiment in one scene bundle that flags describe and not a file: `segsim ros serve`
/// and `segsim gazebo drive` write such a spec, so that their trials have the parts and the
/// rules of any other.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/scene_bundle.h"

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class App;
}

namespace segsim::experiments::commands::bridges {

struct BundleSpec {
  std::filesystem::path bundle;
  std::vector<std::string> goals;
  int episodes = 1;
  std::string arm;  ///< Its name, and that of the experiment.
  std::string robot = "jackal-gentle", detector = "none", backend = "auto";
  std::vector<std::string> sensors;  ///< Besides the camera, as usual.
  /// Starts may see the goal or be near it; else as in specs, with the usual distances.
  bool any_start = true;
  double rate_hz = 10.0, limit_s = 600.0;
  int width_px = 640, height_px = 480;
  double hfov_deg = 70.0, pitch_down_deg = 0.0, depth_range_m = 6.0, camera_height_m = 0.0;
  std::uint64_t seed = 1;

  /// The spec without policy, clock and motion, which the caller appends.
  [[nodiscard]] std::string text(const core::SceneManifest& scene) const;
  /// @throws core::InputError: a goal that the scene lacks, a rate that is no whole number of
  /// simulation steps.
  void check(const core::SceneManifest& scene) const;
};

/// Robot, camera, rate, time limit, seed and backend. @param spec  Outlives the command.
void add_bundle_flags(CLI::App& command, BundleSpec& spec);

}  // namespace segsim::experiments::commands::bridges
