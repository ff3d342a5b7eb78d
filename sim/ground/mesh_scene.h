#pragma once

/// @file
/// Textured triangle meshes with exact class and instance labels: the ground truth that
/// captures are taken from. Sources: Gazebo worlds, any file that assimp reads, the procedural
/// flat.

#include <cstdint>
#include <string>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/image.h"
#include "core/scene_bundle.h"

namespace segsim::sim {

struct Material {
  glm::vec3 albedo{0.7F};    ///< Linear RGB, multiplied with the texture.
  int texture = -1;          ///< Into MeshScene::textures; -1 = none.
  glm::vec3 emission{0.0F};  ///< Linear RGB radiance.
};

/// One indexed triangle mesh with one material that belongs to one instance.
struct SubMesh {
  std::vector<glm::vec3> positions_m;  ///< World frame.
  std::vector<glm::vec3> normals;      ///< Per vertex, unit.
  std::vector<glm::vec2>
      uvs;  ///< Per vertex; v grows upwards (OpenGL). Repeat outside [0, 1].
  std::vector<glm::uvec3> triangles;
  int material = 0;
  std::uint16_t class_id = 0;     ///< 0 = void.
  std::uint16_t instance_id = 0;  ///< 0 = none (stuff).
};

/// Sphere-shaped lamp.
struct PointLight {
  glm::vec3 position_m{0.0F};
  glm::vec3 radiance{
      1.0F};              ///< Linear RGB; irradiance at distance d is radiance / (d^2 + 0.15).
  float radius_m = 0.3F;  ///< For soft shadows.
};

/// What became of a wording in the names of a world's objects, for a person to check.
struct ClassGuess {
  std::string words;  ///< Of the names, in lower case: "office chair".
  std::uint16_t class_id = 0;
  int count = 0;  ///< Objects.
};

struct MeshScene {
  std::string name;
  std::vector<SubMesh> meshes;
  std::vector<Material> materials;
  std::vector<core::Image<core::Rgb8>> textures;  ///< sRGB; row 0 is the top (v = 1).
  std::vector<PointLight> lights;
  std::vector<core::SceneClass> classes;
  std::vector<core::SceneInstance> instances;
  std::vector<ClassGuess>
      class_guesses;                  ///< In order of first appearance; empty: by no names.
  std::vector<std::string> warnings;  ///< Counted and shown, for example a missing texture.
  std::string source;                 ///< In words, for provenance.

  [[nodiscard]] std::size_t triangle_count() const {
    std::size_t count = 0;
    for (const SubMesh& mesh : meshes) count += mesh.triangles.size();
    return count;
  }
};

}  // namespace segsim::sim
