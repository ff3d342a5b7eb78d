#include "worlds/surface/mesh_distance.h"

#include <cmath>

#include <vtkNew.h>
#include <vtkPolyData.h>
#include <vtkStaticCellLocator.h>

#include "core/error.h"
#include "worlds/surface/internal/vtk_mesh.h"

namespace segsim::worlds {

struct MeshDistance::Locator {
  explicit Locator(const sim::TriangleMesh& triangles) : mesh(internal::to_vtk(triangles)) {
    cells->SetDataSet(mesh);
    cells->BuildLocator();
  }
  vtkNew<vtkPolyData> mesh;
  vtkNew<vtkStaticCellLocator> cells;
};

MeshDistance::MeshDistance(const sim::TriangleMesh& mesh) {
  if (mesh.triangles.empty()) {
    throw core::InputError::expected("mesh", "triangles to measure against", "none");
  }
  locator_ = std::make_unique<Locator>(mesh);
}

MeshDistance::~MeshDistance() = default;
MeshDistance::MeshDistance(MeshDistance&&) noexcept = default;
MeshDistance& MeshDistance::operator=(MeshDistance&&) noexcept = default;

double MeshDistance::to_m(const glm::vec3& p_m) const {
  const glm::dvec3 p(p_m);
  glm::dvec3 nearest(0.0);
  vtkIdType cell = 0;
  int part = 0;
  double squared = 0.0;
  locator_->cells->FindClosestPoint(&p.x, &nearest.x, cell, part, squared);
  return std::sqrt(squared);
}

}  // namespace segsim::worlds
