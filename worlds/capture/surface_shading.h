#pragma once

/// @file
/// What a ray finds where it hits a MeshScene: smooth normal, material and filtered texture
/// colour.

#include <vector>

#include <glm/vec3.hpp>

#include "sim/ground/mesh_scene.h"
#include "sim/ground/ray_scene.h"

namespace segsim::worlds {

/// Keeps copies of what shading needs: normals, texture coordinates, mip-mapped textures.
class SurfaceShading {
 public:
  /// @throws ContractViolation if a mesh or a material refers to what the scene does not have.
  explicit SurfaceShading(const sim::MeshScene& scene);

  /// Unit shading normal, turned to the side that `direction` comes from.
  [[nodiscard]] glm::vec3 smooth_normal(const sim::RayHit& hit,
                                        const glm::vec3& direction) const;
  /// Linear RGB. @param footprint_m  Width of the surface patch to average over.
  [[nodiscard]] glm::vec3 albedo(const sim::RayHit& hit, float footprint_m) const;
  /// Linear RGB radiance that the surface emits.
  [[nodiscard]] const glm::vec3& emission(const sim::RayHit& hit) const {
    return materials_[static_cast<std::size_t>(meshes_[hit.mesh].material)].emission;
  }

 private:
  struct Mesh {
    std::vector<glm::vec3> normals;  ///< Empty = flat.
    std::vector<glm::vec2> uvs;      ///< Empty = none.
    std::vector<glm::uvec3> triangles;
    std::vector<float> uv_per_m;  ///< Per triangle: texture units per metre; empty = none.
    int material = 0;
  };
  using MipChain = std::vector<core::Image<core::Rgb8>>;

  std::vector<Mesh> meshes_;
  std::vector<sim::Material> materials_;
  std::vector<MipChain> textures_;  ///< Level 0 is the full size.
};

/// sRGB bytes of a linear colour; components are clamped to [0, 1].
[[nodiscard]] core::Rgb8 srgb_from_linear(const glm::vec3& linear);

}  // namespace segsim::worlds
