#pragma once

/// @file
/// Where to hold the camera so that a capture covers a home: in every room, away from
/// furniture.

#include <cstdint>
#include <filesystem>
#include <numbers>
#include <vector>

#include "core/frames.h"
#include "sim/ground/mesh_scene.h"

namespace segsim::worlds {

struct CapturePlan {
  double spacing_m = 1.2;     ///< Between places.
  double clearance_m = 0.35;  ///< From anything between 0.1 m and 1.8 m above the floor.
  double cell_m = 0.05;       ///< Of the free-space grid.
  /// Evenly spread headings. Those that face something nearer than `min_view_m` are left out.
  int views_per_place = 5;
  double min_view_m = 0.9;
  /// Cycled through from place to place.
  std::vector<double> heights_m{1.25, 0.8, 1.5};
  /// Cycled through from view to view; positive looks down.
  std::vector<double> pitches_down_rad{0.15, 0.35, -0.1, 0.2, 0.05, 0.5};
  int max_views = 0;  ///< 0 = no limit; otherwise places are thinned evenly to keep coverage.
  std::uint64_t seed = 1;
};

/// Cameras in the largest connected free area that has a floor (z = 0 +- 0.1 m) below it and,
/// if the scene has a ceiling, something above. Places are visited in a walk of short steps.
/// @throws InputError if the scene has no free floor.
[[nodiscard]] std::vector<core::CameraPose> plan_capture_trajectory(
    const sim::MeshScene& scene, const CapturePlan& plan = {});

/// Reads a trajectory: per line either "x y z yaw pitch_down" (metres and radians; yaw
/// counter-clockwise from +x, pitch positive down) or TUM's "timestamp x y z qx qy qz qw"
/// (camera to world). Empty lines and lines with # are skipped.
/// @throws InputError naming file and line.
[[nodiscard]] std::vector<core::CameraPose> read_trajectory(const std::filesystem::path& file);

}  // namespace segsim::worlds
