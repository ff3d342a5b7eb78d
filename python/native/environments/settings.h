#pragma once

/// @file
/// What environments can be told in Python, with the words that Python has for it.

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>

#include "experiments/episodes/episodes.h"
#include "sim/trial/environment/discrete_actions.h"
#include "sim/trial/environment/episode_pool.h"
#include "sim/trial/environment/object_nav_environment.h"

namespace segsim::python {

/// Defaults are those of experiments (experiments/specs/spec.h) where these have the same.
struct EnvironmentSettings {
  std::string robot = "jackal";
  std::pair<int, int> size{256, 192};
  double horizontal_fov_rad = 1.2217304763960306;  ///< 70 degrees.
  std::optional<double> camera_height_m;           ///< None: the robot's.
  double camera_pitch_down_rad = 0.0;
  double depth_range_m = 6.0;
  std::vector<std::string> images{"rgb", "depth"};
  std::string action = "discrete";
  double forward_step_m = 0.25;
  double turn_step_rad = 0.5235987755982988;  ///< 30 degrees.
  double control_period_s = 0.1;
  double time_limit_s = 180.0;
  std::string contact = "stop";
  std::string collision = "footprint";
  std::string localisation = "exact";
  double success_distance_m = 1.0;
  bool require_visible = true;
  int visible_pixels = 40;
  bool rewards = true;
  double success_reward = 2.5;
  std::vector<std::string> goals;         ///< Empty: all classes of things in the scene.
  std::vector<std::string> goal_classes;  ///< What goals are numbered by; empty: `goals`.
  int episode_count = 100;
  std::uint64_t episode_seed = 1;
  double min_start_m = 2.0, max_start_m = 15.0;
  bool allow_visible_start = false;
  std::string order = "shuffled";
};

/// @throws core::InputError naming the setting. Names of robots and classes are not looked at.
void check_settings(const EnvironmentSettings& settings);

/// @pre check_settings() accepts them.
[[nodiscard]] sim::EnvironmentOptions environment_options(const EnvironmentSettings& settings,
                                                          const sim::RobotModel& robot);
[[nodiscard]] sim::EpisodeOrder::Kind order_of(const EnvironmentSettings& settings);
/// Rules of episodes that are made for want of a file.
[[nodiscard]] experiments::episodes::EpisodeRules episode_rules(
    const EnvironmentSettings& settings, const sim::EnvironmentOptions& options,
    std::vector<std::string> goals);

/// EnvironmentSettings.
void bind_settings(nanobind::module_& module);

}  // namespace segsim::python
