#pragma once

/// @file
/// What the importers share: mesh files read once, textures read once, placing of parts.

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/class_names.h"
#include "worlds/mesh/texture_reader.h"

struct aiScene;
struct aiMaterial;

namespace segsim::worlds::internal {

/// Triangles of one node, in the file's frame with all node transforms applied.
struct MeshPart {
  std::string node_name, mesh_name;
  std::vector<glm::vec3> positions;
  std::vector<glm::vec3> normals;  ///< Unit.
  std::vector<glm::vec2> uvs;
  std::vector<glm::uvec3> triangles;
  int material = 0;  ///< Into the scene's materials.
};

/// Linear RGB of an sRGB colour, each component in [0, 1].
[[nodiscard]] glm::vec3 linear_colour(const glm::vec3& srgb);

/// The emission of a lamp or a screen. Black for weak ones: editors give surfaces a glow so
/// that no shadow is black.
[[nodiscard]] glm::vec3 lamp_emission(const glm::vec3& emission);

/// ".dae" of "Chair.DAE".
[[nodiscard]] std::string lower_case_extension(const std::filesystem::path& file);

/// The file that a URI such as "model://chair/materials/textures/chair.png" means, named in a
/// file of `folder`.
using UriFinder = std::function<std::optional<std::filesystem::path>(
    const std::string& uri, const std::filesystem::path& folder)>;

/// The files that the texture `name` of a mesh file in `folder` may mean, the best one first:
/// where the name says, then by its base name in the folders that Gazebo models use, because
/// many files name a path of the machine that they were made on.
/// @param find_uri  May be empty.
[[nodiscard]] std::vector<std::filesystem::path> texture_files(
    const std::string& name, const std::filesystem::path& folder, const UriFinder& find_uri);

/// Reads mesh files with assimp; materials and textures go into the scene, each file once.
class MeshFileReader {
 public:
  /// @param find_uri  Resolves textures that are URIs; empty: none are.
  /// @param scene, pixels  Outlive the reader.
  MeshFileReader(sim::MeshScene& scene, const TextureReader& pixels, UriFinder find_uri = {})
      : scene_(scene), pixels_(pixels), find_uri_(std::move(find_uri)) {}

  /// Numbers that had to be mended (number_mending.h) are a warning of the scene.
  /// @throws InputError if the file is missing, unreadable or has a vertex that is not finite.
  const std::vector<MeshPart>& read(const std::filesystem::path& file);
  /// Index of the texture in an image file; -1 if it is no image.
  int texture_of_file(const std::filesystem::path& file);

 private:
  sim::Material read_material(const aiScene& file_scene, const aiMaterial& source,
                              const std::filesystem::path& file);
  /// Index of the texture, or -1 with a warning.
  int texture(const aiScene& file_scene, const std::string& name,
              const std::filesystem::path& file);
  int add_texture(const std::string& key, core::Image<core::Rgb8> image);

  sim::MeshScene& scene_;
  const TextureReader& pixels_;
  UriFinder find_uri_;
  std::map<std::string, std::vector<MeshPart>> files_;
  std::map<std::string, int> textures_;
};

/// Appends a part to the scene. @param T_world_part  May scale and mirror.
void place_part(sim::MeshScene& scene, const MeshPart& part, const glm::dmat4& T_world_part,
                const LabelTable::Ids& ids);

}  // namespace segsim::worlds::internal
