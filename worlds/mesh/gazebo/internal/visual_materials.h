#pragma once

/// @file
/// What a visual's <material> says, and the names of the textures that mesh files ask for.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <sdf/sdf.hh>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/gazebo/internal/material_script.h"
#include "worlds/mesh/gazebo/internal/missing_files.h"
#include "worlds/mesh/gazebo/internal/resource_finder.h"

namespace segsim::worlds::internal {

/// A material that no image has been read for yet.
struct PlannedMaterial {
  sim::Material colours;          ///< Without its texture.
  std::filesystem::path texture;  ///< Empty: none.
};

/// Reads materials in the order in which they count: the image of <pbr>, a script, colours. A
/// colour that is written down beside a script takes the place of the script's.
class VisualMaterials {
 public:
  /// @param finder, missing  Outlive it.
  VisualMaterials(const ResourceFinder& finder, MissingFiles& missing)
      : finder_(finder), missing_(missing) {}

  /// Nullopt if nothing is said, or only the name of a script that is missing: meshes then
  /// keep their own materials.
  /// @param user  Named in messages about missing files.
  [[nodiscard]] std::optional<PlannedMaterial> plan(const sdf::Visual& visual,
                                                    const std::string& user);

 private:
  [[nodiscard]] std::optional<ScriptedMaterial> scripted(const sdf::ElementPtr& script,
                                                         const std::string& user);
  [[nodiscard]] std::optional<std::filesystem::path> script_texture(
      const ScriptedMaterial& material,
      const std::vector<std::filesystem::path>& folders) const;

  const ResourceFinder& finder_;
  MissingFiles& missing_;
  MaterialScripts scripts_;
};

/// Names of the textures in a COLLADA or OBJ file, found by looking through its text alone;
/// also material libraries of an OBJ file that are missing. Empty for files of other kinds.
[[nodiscard]] std::vector<std::string> texture_names(const std::filesystem::path& mesh_file);

}  // namespace segsim::worlds::internal
