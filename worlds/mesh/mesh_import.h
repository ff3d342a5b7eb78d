#pragma once

/// @file
/// Mesh files of any format that assimp reads (.obj, .glb, .gltf, .dae, .ply, .fbx, ...) as a
/// MeshScene in metres with z up.

#include <cstdint>
#include <filesystem>
#include <string>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/texture_reader.h"

namespace segsim::worlds {

enum class UpAxis : std::uint8_t {
  kAuto,  ///< y for .glb, .gltf, .obj and .fbx, z for the others.
  kY,     ///< (x, y, z) becomes (x, -z, y).
  kZ,     ///< As it is.
};

struct MeshFileOptions {
  UpAxis up = UpAxis::kAuto;
  double scale = 1.0;  ///< Metres per unit of the file, for formats that do not say.
  /// Lights are hung under the ceiling when the scene has none; see add_ceiling_lights.
  bool add_lights = true;
};

/// Loads a file. Every node with triangles is one instance with the node's name; its class
/// follows from the name (class_of_model). Node transforms, and with them COLLADA's unit, are
/// applied; a mirroring transform flips the winding.
/// @throws InputError if the file is missing, unreadable or without triangles.
/// A texture that cannot be found is a warning of the scene, and the material's colour is
/// used.
[[nodiscard]] sim::MeshScene load_mesh_file(const std::filesystem::path& file,
                                            const MeshFileOptions& options = {},
                                            const TextureReader& textures = image_textures());

/// Hangs a square grid of soft warm-white lamps over the scene's floor plan: 2.8 m apart,
/// 0.45 m below `height_m`. Game worlds are lit by lamps that ignore walls; these do not.
void add_ceiling_lights(sim::MeshScene& scene, double height_m, double spacing_m = 2.8);

}  // namespace segsim::worlds
