#pragma once

/// @file
/// How a Gazebo world is read.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace segsim::worlds {

/// What is done about models and meshes that a world names and that are not there. Missing
/// textures and material scripts are warnings in any case.
enum class OnMissing : std::uint8_t {
  kError,      ///< One message names all of them, before any mesh is loaded.
  kCollision,  ///< The link's collision shape takes the place of a mesh; else as kSkip.
  kSkip,       ///< They are left out, with a warning for each.
};

enum class CeilingKind : std::uint8_t {
  kNone,    ///< As the world is.
  kWalls,   ///< A flat one at the walls' height, unless the world has one.
  kHeight,  ///< A flat one at `height_m`.
  kModel,   ///< A model that the world brings along and leaves open, at `height_m`.
};

struct CeilingOptions {
  CeilingKind kind = CeilingKind::kWalls;
  double height_m = 0.0;  ///< Above z = 0; kHeight and kModel only.
  std::string model;      ///< kModel only: its name, as behind "model://".
};

struct GazeboImportOptions {
  /// Where models, meshes and materials are looked for first; then come Gazebo's environment
  /// variables and the folders around the world (docs/worlds.md).
  std::vector<std::filesystem::path> resource_paths;
  OnMissing on_missing = OnMissing::kError;
  CeilingOptions ceiling;
  /// The lamps of a world are tuned to Gazebo's rasteriser, in which light passes walls: they
  /// are replaced by a grid of soft lamps below the ceiling (add_ceiling_lights).
  double light_spacing_m = 2.8;
  /// Asked before the rules of class_of_model, with the words of a name ("office chair").
  /// Returns a class, "unknown" for one that is none on purpose, or nullopt. May be empty.
  std::function<std::optional<std::string>(const std::string& words)> corrected_class;
};

}  // namespace segsim::worlds
