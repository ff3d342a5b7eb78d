#pragma once

/// @file
/// Where the pictures of a labelled data set are taken: places that the robot can reach,
/// chosen at random or along a scripted drive.

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "core/frames.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "sim/ground/world.h"

namespace segsim::experiments::scenes {

/// Two views are alike if they are nearer than both.
struct ViewDistance {
  double distance_m = 0.3, angle_rad = 0.35;
  [[nodiscard]] bool alike(const core::Pose2& a, const core::Pose2& b) const;
};

struct ViewSamplerOptions {
  std::uint64_t seed = 1;
  double share_facing_object = 0.85;
  double max_object_distance_m = 5.0;
  ViewDistance near_duplicate;
  std::vector<glm::dvec2> avoid_m;  ///< No view nearer than `avoid_radius_m` to any of them.
  double avoid_radius_m = 0.0;
};

/// Draws places and directions on the robot's free space. Deterministic in the seed.
class ViewSampler {
 public:
  /// @param scene_classes  With the names that count (after any class map).
  /// @throws core::InputError if the robot has no room, or none outside what it avoids.
  ViewSampler(const sim::World& world, std::span<const core::SceneClass> scene_classes,
              std::span<const std::string> class_names, const ViewSamplerOptions& options);

  struct View {
    core::Pose2 pose;
    std::uint16_t wanted_instance = 0;  ///< That the view was made for; 0 = none.
  };
  [[nodiscard]] View next();

  [[nodiscard]] bool is_near_duplicate(const core::Pose2& pose) const;
  [[nodiscard]] bool is_avoided(const core::Pose2& pose) const;
  void accept(const core::Pose2& pose) { accepted_.push_back(pose); }

 private:
  ViewSamplerOptions options_;
  core::RandomStream random_;
  std::vector<glm::dvec2> cells_;
  std::map<std::uint16_t, std::vector<const core::SceneInstance*>> objects_by_class_;
  std::vector<core::Pose2> accepted_;
};

/// A scripted drive:
///
///     schema: segsim.drive
///     version: 1
///     scene: flat-3             # optional: only for the bundle of this name
///     every_m: 0.5              # a picture every so many metres
///     turn_every_deg: 45        # and every so many degrees where the path turns
///     way_points: [[0.5, 1.0], [3.0, 1.0], [3.0, 4.5]]      # world frame, m
struct Drive {
  std::string scene;
  double every_m = 0.5, turn_every_rad = 0.785398163397448310;
  std::vector<glm::dvec2> way_points_m;
  std::string origin;  ///< The file, for messages.
};

/// @throws core::InputError naming file, line and key: fewer than two way-points, a step <= 0.
[[nodiscard]] Drive read_drive(const std::filesystem::path& file);

/// Poses along the drive. The robot goes from way-point to way-point the shortest way through
/// its free space, looks ahead, and turns on the spot where the path does.
/// @throws core::InputError naming the way-point that cannot be reached from the one before.
[[nodiscard]] std::vector<core::Pose2> drive_poses(const sim::World& world,
                                                   const Drive& drive);

}  // namespace segsim::experiments::scenes
