#pragma once

/// @file
/// Gazebo worlds (SDF) as a MeshScene. Only what is seen is read: visuals of all models,
/// included and nested ones too, with meshes, boxes, cylinders, spheres and planes, and their
/// materials.

#include <filesystem>
#include <string>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/texture_reader.h"

namespace segsim::worlds {

struct GazeboImportOptions {
  /// Where "model://<name>" lies; empty = the folder "models" beside the world file's folder.
  std::filesystem::path models_folder;
  /// Adds a ceiling model to worlds that are delivered open for a better view from above.
  bool add_ceiling = false;
  std::string ceiling_model = "aws_robomaker_residential_RoomCeiling_01";
  double ceiling_height_m = 2.5;
  /// The lamps of a world are tuned to Gazebo's rasteriser, in which light passes walls: they
  /// are replaced by a grid of soft lamps below the ceiling (add_ceiling_lights).
  double light_spacing_m = 2.8;
};

/// Loads the first world of an SDF file. Every top-level model is one instance with its name.
///
/// Departures of real worlds that are accepted: `<pose frame=''>`, COLLADA with an up axis
/// that Gazebo ignores, texture paths of another machine (looked for by base name in
/// `../materials/textures` and `<models>/../photos`), missing textures (the material's colour
/// is used), and errors that leave the world readable, such as an invalid inertia. All but the
/// first three are counted in MeshScene::warnings.
/// @throws InputError  no such file, no world in it, or a mesh file that is missing or
/// unreadable.
[[nodiscard]] sim::MeshScene load_gazebo_world(
    const std::filesystem::path& world_file, const GazeboImportOptions& options = {},
    const TextureReader& textures = image_textures());

}  // namespace segsim::worlds
