#include "python/native/environments/settings.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "core/error.h"
#include "core/formatted.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;

constexpr int kLargestSide_px = 8192;

/// Index of the word among those that can stand there.
std::size_t choice(const char* name, const std::string& word,
                   std::initializer_list<const char*> words) {
  std::string all;
  std::size_t index = 0;
  for (const char* candidate : words) {
    if (word == candidate) return index;
    all += (index++ == 0 ? "" : " | ") + std::string(candidate);
  }
  throw core::InputError::expected(name, all, "\"" + word + "\"");
}

void check_number(const char* name, double value, double least, double most) {
  if (value >= least && value <= most) return;
  throw core::InputError::expected(name, core::print("%g to %g", least, most),
                                   core::print("%g", value));
}

std::size_t contact_of(const EnvironmentSettings& s) {
  return choice("contact", s.contact, {"stop", "slide", "end"});
}
std::size_t collision_of(const EnvironmentSettings& s) {
  return choice("collision", s.collision, {"footprint", "navmesh"});
}
std::size_t localisation_of(const EnvironmentSettings& s) {
  return choice("localisation", s.localisation, {"exact", "odometry", "localiser"});
}

}  // namespace

void check_settings(const EnvironmentSettings& s) {
  for (const int side_px : {s.size.first, s.size.second}) {
    if (side_px >= 1 && side_px <= kLargestSide_px) continue;
    throw core::InputError::expected(
        "size", "width and height of 1 to " + std::to_string(kLargestSide_px) + " pixels",
        std::to_string(s.size.first) + " x " + std::to_string(s.size.second));
  }
  // The ranges are those of specs of experiments.
  constexpr double kDegree = std::numbers::pi / 180.0;
  check_number("horizontal_fov_rad", s.horizontal_fov_rad, 10.0 * kDegree, 150.0 * kDegree);
  if (s.camera_height_m) check_number("camera_height_m", *s.camera_height_m, 0.05, 3.0);
  check_number("camera_pitch_down_rad", s.camera_pitch_down_rad, -1.5, 1.5);
  check_number("depth_range_m", s.depth_range_m, 0.1, 1000.0);
  check_number("forward_step_m", s.forward_step_m, 0.001, 10.0);
  check_number("turn_step_rad", s.turn_step_rad, 0.001, std::numbers::pi);
  check_number("control_period_s", s.control_period_s, 0.005, 10.0);
  check_number("time_limit_s", s.time_limit_s, s.control_period_s, 100000.0);
  check_number("success_distance_m", s.success_distance_m, 0.01, 100.0);
  check_number("visible_pixels", s.visible_pixels, 1.0, 1e8);
  check_number("success_reward", s.success_reward, -1e9, 1e9);
  check_number("min_start_m", s.min_start_m, 0.0, 1000.0);
  check_number("max_start_m", s.max_start_m, s.min_start_m, 1000.0);
  check_number("episode_count", s.episode_count, 1.0, 1e6);
  const double substeps = s.control_period_s / sim::TrialOptions{}.substep_s;
  if (std::abs(substeps - std::round(substeps)) > 1e-6) {
    throw core::InputError::expected("control_period_s", "a multiple of 0.005 s",
                                     core::print("%g", s.control_period_s));
  }
  for (const std::string& image : s.images) {
    static_cast<void>(choice("images", image, {"rgb", "depth", "semantic", "instance"}));
  }
  static_cast<void>(choice("action", s.action, {"discrete", "continuous"}));
  static_cast<void>(contact_of(s));
  static_cast<void>(collision_of(s));
  static_cast<void>(localisation_of(s));
  static_cast<void>(order_of(s));
}

sim::EnvironmentOptions environment_options(const EnvironmentSettings& s,
                                            const sim::RobotModel& robot) {
  sim::EnvironmentOptions options;
  sim::TrialOptions& trial = options.trial;
  trial.camera =
      core::CameraIntrinsics::from_fov(s.size.first, s.size.second, s.horizontal_fov_rad);
  trial.camera_height_m = s.camera_height_m.value_or(robot.camera_height_m);
  trial.camera_pitch_down_rad = s.camera_pitch_down_rad;
  trial.depth_range_m = s.depth_range_m;
  trial.control_period_s = s.control_period_s;
  trial.time_limit_s = s.time_limit_s;
  trial.success_distance_m = s.success_distance_m;
  trial.require_visible = s.require_visible;
  trial.visible_pixels = s.visible_pixels;
  const std::size_t contact = contact_of(s);
  if (contact == 1) trial.contact_response = sim::ContactResponse::kSlide;
  trial.stop_on_contact = contact == 2;
  if (collision_of(s) == 1) trial.collision = sim::CollisionMode::kNavmesh;
  const std::size_t localisation = localisation_of(s);
  if (localisation == 1) trial.odometry = sim::OdometryNoise::skid_steered_indoors();
  if (localisation == 2) trial.localiser = sim::LocaliserModel{};
  const bool labels = std::any_of(s.images.begin(), s.images.end(), [](const std::string& n) {
    return n == "semantic" || n == "instance";
  });
  if (labels) options.channels = options.channels | core::Channels::kLabels;
  options.rewards = s.rewards;
  options.success_reward = s.success_reward;
  return options;
}

sim::EpisodeOrder::Kind order_of(const EnvironmentSettings& s) {
  return choice("order", s.order, {"shuffled", "in_turn"}) == 0
             ? sim::EpisodeOrder::Kind::kShuffled
             : sim::EpisodeOrder::Kind::kInTurn;
}

experiments::episodes::EpisodeRules episode_rules(const EnvironmentSettings& s,
                                                  const sim::EnvironmentOptions& options,
                                                  std::vector<std::string> goals) {
  experiments::episodes::EpisodeRules rules;
  rules.goals = std::move(goals);
  rules.count = s.episode_count;
  rules.seed = s.episode_seed;
  rules.camera = options.trial.camera;
  rules.camera_height_m = options.trial.camera_height_m;
  rules.camera_pitch_down_rad = s.camera_pitch_down_rad;
  rules.min_visible_pixels = s.visible_pixels;
  rules.visible_start_pixels = s.visible_pixels;
  rules.min_start_m = s.min_start_m;
  rules.max_start_m = s.max_start_m;
  rules.allow_visible_start = s.allow_visible_start;
  return rules;
}

void bind_settings(nb::module_& module) {
  using S = EnvironmentSettings;
  nb::class_<S>(module, "EnvironmentSettings",
                "How robot, camera, time, success and episodes of environments are; "
                "docs/python_environments.md explains each.")
      .def(nb::init<>())
      .def_rw("robot", &S::robot, "A built-in robot, or the path of a robot file.")
      .def_rw("size", &S::size, "Width and height of the images, pixels.")
      .def_rw("horizontal_fov_rad", &S::horizontal_fov_rad, "Of the camera.")
      .def_rw("camera_height_m", &S::camera_height_m, nb::arg().none(),
              "Above the floor; None: the robot's.")
      .def_rw("camera_pitch_down_rad", &S::camera_pitch_down_rad, "Of the camera.")
      .def_rw("depth_range_m", &S::depth_range_m, "Farther is not measured.")
      .def_rw("images", &S::images, "Of 'rgb', 'depth', 'semantic', 'instance'.")
      .def_rw("action", &S::action, "'discrete' or 'continuous'.")
      .def_rw("forward_step_m", &S::forward_step_m, "Of the discrete action 1.")
      .def_rw("turn_step_rad", &S::turn_step_rad, "Of the discrete actions 2 and 3.")
      .def_rw("control_period_s", &S::control_period_s, "How long one command holds.")
      .def_rw("time_limit_s", &S::time_limit_s, "Simulated time of an episode.")
      .def_rw("contact", &S::contact, "'stop', 'slide' or 'end'.")
      .def_rw("collision", &S::collision, "'footprint' or 'navmesh'.")
      .def_rw("localisation", &S::localisation, "'exact', 'odometry' or 'localiser'.")
      .def_rw("success_distance_m", &S::success_distance_m,
              "STOP must be nearer than this to a view point.")
      .def_rw("require_visible", &S::require_visible, "The goal must be in view, too.")
      .def_rw("visible_pixels", &S::visible_pixels, "From so many on it is in view.")
      .def_rw("rewards", &S::rewards, "False: every reward is 0.")
      .def_rw("success_reward", &S::success_reward, "Added for a success.")
      .def_rw("goals", &S::goals, "Classes to search; empty: all things of the scene.")
      .def_rw("goal_classes", &S::goal_classes,
              "What the observation's goal counts; empty: the goals.")
      .def_rw("episode_count", &S::episode_count, "Of episodes that are made.")
      .def_rw("episode_seed", &S::episode_seed, "Of episodes that are made.")
      .def_rw("min_start_m", &S::min_start_m, "Way to the nearest view point, at least.")
      .def_rw("max_start_m", &S::max_start_m, "Way to the nearest view point, at most.")
      .def_rw("allow_visible_start", &S::allow_visible_start,
              "Whether the goal may be in view from the start.")
      .def_rw("order", &S::order, "'shuffled' or 'in_turn'.");
}

}  // namespace segsim::python
