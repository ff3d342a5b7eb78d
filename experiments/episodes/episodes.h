#pragma once

/// @file
/// Search tasks in a scene: generated from the bundle, kept as JSON Lines (a header line, then
/// one episode per line), so that every arm and every later run gets the same ones.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/render.h"
#include "core/scene_bundle.h"
#include "sim/ground/world.h"
#include "sim/trial/episode_sampling.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::episodes {

/// A goal in words, and the things of the scene that it means.
struct PhraseGoal {
  std::string phrase;      ///< "a red chair".
  std::string class_name;  ///< Of all of them.
  std::vector<std::uint16_t> instances;
};

/// What makes a place a view point and a pose a start.
struct EpisodeRules {
  std::vector<std::string> goals;   ///< Class names.
  std::vector<PhraseGoal> phrases;  ///< Goals as well, after these.
  int count = 20;                   ///< Episodes over all goals, balanced between them.
  std::uint64_t seed = 1;
  core::CameraIntrinsics camera;
  double camera_height_m = 1.2, camera_pitch_down_rad = 0.0;
  /// A view point lies this near to its object (in plan); the ring grows by
  /// `view_radius_step_m` up to the largest radius until the robot's own camera sees the
  /// object from somewhere.
  double view_radius_m = 1.0, view_radius_step_m = 0.5, max_view_radius_m = 2.0;
  /// From a view point the robot, facing the object, must see at least this many of its
  /// pixels.
  int min_visible_pixels = 40;
  double min_visible_share =
      0.002;  ///< ... and this share of the image (Habitat's rule: 0.2 %).
  double min_start_m = 2.0, max_start_m = 15.0;  ///< Geodesic, start to nearest view point.
  bool allow_visible_start = false;
  int visible_start_pixels = 40;  ///< From so many goal pixels on, the goal counts as in view.
  double view_lattice_m = 0.25;   ///< Of the places that are tested as view points.
  /// Starts whose geodesic is below this times the straight distance are accepted only with
  /// probability 20 (ratio - 0.98)^2 (Habitat's PointNav sampling, there with 1.1); 1 = all.
  double min_ratio = 1.0;
  /// The largest island must have at least the area of this disc; 0 = any.
  double min_island_radius_m = 0.0;
};

/// How many candidates were refused, by reason.
struct EpisodeRejections {
  int goals_without_instance = 0;  ///< Classes.
  int instances_not_visible = 0;   ///< Instances that no place sees.
  int view_points_tested = 0, view_points_kept = 0;
  int starts_goal_visible = 0;
  sim::StartRejections starts;
};

/// The camera that decided what is visible; validation looks through it again.
struct EpisodeViewer {
  core::CameraIntrinsics camera;
  double camera_height_m = 1.2, camera_pitch_down_rad = 0.0;
};

/// What the oracle-path arm made of a set (docs/episodes.md).
struct OracleRecord {
  static constexpr double kExpected = 0.95;  ///< Sets below are flagged.

  int successes = 0, episodes = 0;
  double spl = 0.0;
  std::string profile;  ///< Success rule.
  [[nodiscard]] double rate() const {
    return episodes > 0 ? static_cast<double>(successes) / episodes : 0.0;
  }
};

struct EpisodeSet {
  static constexpr const char* kSchema = "segsim.episodes/2";
  static constexpr const char* kFirstSchema = "segsim.episodes/1";  ///< Read as well.
  /// With goals that are phrases: who cannot read them must not take them for classes.
  static constexpr const char* kPhraseSchema = "segsim.episodes/3";

  std::string scene;         ///< Name; it begins every episode's id.
  std::string scene_sha256;  ///< Of the bundle they belong to; empty if imported without one.
  std::string robot;
  std::string generator;       ///< Program and version, or what it was imported from.
  std::uint64_t seed = 0;      ///< Of the generator.
  std::string navmesh_sha256;  ///< Of the settings behind every length.
  std::optional<EpisodeViewer> viewer;
  std::optional<OracleRecord> oracle;  ///< None: not validated.
  std::string rules_sha256;  ///< Of the rules they were made by; changes when a rule changes.
  EpisodeRejections rejections;
  std::vector<sim::Episode> episodes;
};

/// Deterministic in its arguments. Fewer than `rules.count` episodes if the scene has no room
/// for more.
/// @throws core::InputError if no goal class can be searched at all.
[[nodiscard]] EpisodeSet generate_episodes(const std::string& scene_name,
                                           const core::SceneBundle& bundle,
                                           const sim::World& world, core::Renderer& renderer,
                                           const EpisodeRules& rules);

/// Hash over the navmesh settings of a robot and the cell of the free space.
[[nodiscard]] std::string navmesh_settings_hash(const sim::RobotModel& robot);

/// Hash over every rule, for EpisodeSet::rules_sha256.
[[nodiscard]] std::string rules_hash(const EpisodeRules& rules, const std::string& robot);

void write_episodes(const std::filesystem::path& file, const EpisodeSet& set);
/// @throws core::InputError with file and line.
[[nodiscard]] EpisodeSet read_episodes(const std::filesystem::path& file);

}  // namespace segsim::experiments::episodes
