#pragma once

/// @file
/// Furniture libraries of Sweet Home 3D (.sh3f): a zip file with OBJ models, their materials
/// and textures, and PluginFurnitureCatalog.properties, which names them. Debian's package
/// sweethome3d-furniture has five of them with 820 models.

#include <filesystem>
#include <string>
#include <vector>

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/texture_reader.h"

namespace segsim::worlds {

/// Where Debian's package puts its libraries.
inline constexpr const char* kFurnitureFolder = "/usr/share/sweethome3d/furniture";

/// One row of a catalogue.
struct FurnitureModel {
  std::string id;                 ///< Of the whole world: "Scopia#bed1".
  std::string name;               ///< In words: "Bed".
  std::string creator;            ///< To be credited.
  std::string license;            ///< Of the library, as it says itself.
  std::filesystem::path library;  ///< The .sh3f file.
  std::string mesh;               ///< Entry of the zip file.
  glm::vec3 size_m{0.0F};         ///< Width along x, depth along y, height along z.
  float elevation_m = 0.0F;       ///< Of its lowest point above the floor.
  float surface_m = 0.0F;  ///< Height above its lowest point where things can be put on it.
  glm::mat3 R_upright_file{1.0F};  ///< Turns the file's axes to y up, front towards +z.
};

/// The catalogue of one library, in its order.
/// @throws InputError for a file that is no zip, is cut short or holds names that lead out of
/// it, for a missing catalogue, a model without a mesh, or a size that no furniture has.
[[nodiscard]] std::vector<FurnitureModel> read_furniture_library(
    const std::filesystem::path& library);

/// The catalogues of all libraries in a folder, by file name.
/// @throws InputError as above, and if one id occurs twice.
[[nodiscard]] std::vector<FurnitureModel> read_furniture_folder(
    const std::filesystem::path& folder);

/// A model's triangles with materials and textures. Coordinates: metres, z up, the middle of
/// its footprint above the origin, its lowest point at z = 0, its front towards -y; each axis
/// is scaled to the catalogue's size.
/// @throws InputError for a mesh that cannot be read, has no triangles, or more than a
/// million.
[[nodiscard]] sim::MeshScene load_furniture_mesh(
    const FurnitureModel& model, const TextureReader& textures = image_textures());

}  // namespace segsim::worlds
