#pragma once

/// @file
/// How far points are from a mesh: to measure a reconstruction against the world it was
/// captured in.

#include <memory>

#include <glm/vec3.hpp>

#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

/// Exact distances to the nearest triangle (VTK's vtkStaticCellLocator).
class MeshDistance {
 public:
  /// @throws core::InputError for a mesh without triangles.
  explicit MeshDistance(const sim::TriangleMesh& mesh);
  ~MeshDistance();
  MeshDistance(MeshDistance&&) noexcept;
  MeshDistance& operator=(MeshDistance&&) noexcept;

  [[nodiscard]] double to_m(const glm::vec3& p_m) const;

 private:
  struct Locator;
  std::unique_ptr<Locator> locator_;
};

}  // namespace segsim::worlds
