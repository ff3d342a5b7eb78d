#pragma once

/// @file
/// Rays against a MeshScene (Embree 3 behind it).

#include <array>
#include <cstdint>
#include <limits>
#include <memory>

#include <glm/vec3.hpp>

#include "sim/ground/mesh_scene.h"

namespace segsim::sim {

struct RayHit {
  static constexpr std::uint32_t kNone = 0xFFFFFFFF;

  float t = std::numeric_limits<float>::infinity();  ///< In units of the direction's length.
  std::uint32_t mesh = kNone;  ///< Into MeshScene::meshes; kNone = no hit.
  std::uint32_t triangle = 0;
  float u = 0, v = 0;      ///< Weights of the triangle's second and third vertex.
  glm::vec3 normal{0.0F};  ///< Geometric, unit; the side that the winding says.

  [[nodiscard]] bool hit() const { return mesh != kNone; }
};

/// Immutable, so all threads may ask at once. Numbers that no ray has throw core::InputError.
class RayScene {
 public:
  static constexpr float kFar = std::numeric_limits<float>::infinity();

  /// Copies the geometry and builds the hierarchy. @param threads  0 = all cores.
  /// @throws ContractViolation for a vertex that is not there, InputError for one far away.
  explicit RayScene(const MeshScene& scene, int threads = 0);
  ~RayScene();
  RayScene(const RayScene&) = delete;
  RayScene& operator=(const RayScene&) = delete;

  /// First hit with t in [t_near, t_far].
  [[nodiscard]] RayHit cast(const glm::vec3& origin_m, const glm::vec3& direction,
                            float t_near = 0.0F, float t_far = kFar) const;
  /// Eight rays from one point; fastest when they are close together, as in an image.
  [[nodiscard]] std::array<RayHit, 8> cast8(const glm::vec3& origin_m,
                                            const std::array<glm::vec3, 8>& directions) const;
  /// Is anything hit with t in [t_near, t_far]?
  [[nodiscard]] bool occluded(const glm::vec3& origin_m, const glm::vec3& direction,
                              float t_near, float t_far) const;

 private:
  struct Embree;
  std::unique_ptr<Embree> embree_;
};

}  // namespace segsim::sim
