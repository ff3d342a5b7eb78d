#pragma once

/// @file
/// Ogre's material scripts (*.material), as far as they say what a surface looks like, and the
/// materials that Gazebo itself brings along.

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include <glm/vec3.hpp>

namespace segsim::worlds::internal {

/// What is seen of a material. Colours are sRGB in [0, 1].
struct ScriptedMaterial {
  std::optional<glm::vec3> diffuse;
  std::optional<glm::vec3> emissive;
  std::string texture;           ///< File name of the first texture_unit; empty: none.
  std::filesystem::path folder;  ///< Of the script.
};

/// Materials by name, from all files that are added.
///
///     material Shop/Floor : Shop/Base      // what Shop/Base says holds unless it is said
///     anew
///     {
///       technique { pass { diffuse 0.8 0.8 0.8  texture_unit { texture floor.png } } }
///     }
///
/// Programs, animations and techniques after the first are passed over.
class MaterialScripts {
 public:
  /// @param file  Read once. @throws core::InputError if it cannot be read.
  void add_file(const std::filesystem::path& file);
  /// Nullptr if no file names it.
  [[nodiscard]] const ScriptedMaterial* find(const std::string& name) const;

 private:
  std::set<std::filesystem::path> files_;
  std::map<std::string, ScriptedMaterial> materials_;
};

/// The material that Gazebo brings along under this name, "Gazebo/Wood" for example; textures
/// among them become the colour that they have from afar. Nullopt for other names.
[[nodiscard]] std::optional<ScriptedMaterial> gazebo_material(std::string_view name);

}  // namespace segsim::worlds::internal
