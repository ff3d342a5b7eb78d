#include "sim/mesh_distance.h"

#include <array>
#include <cmath>

#include <vtkCellArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkStaticCellLocator.h>

#include "core/error.h"

namespace segsim::sim {

struct MeshDistance::Locator {
  vtkNew<vtkPolyData> mesh;
  vtkNew<vtkStaticCellLocator> cells;
};

MeshDistance::MeshDistance(const TriangleMesh& mesh) : locator_(std::make_unique<Locator>()) {
  if (mesh.triangles.empty()) {
    throw core::InputError::expected("mesh", "triangles to measure against", "none");
  }
  vtkNew<vtkPoints> points;
  points->SetDataTypeToFloat();
  for (const glm::vec3& p : mesh.positions_m) points->InsertNextPoint(&p.x);
  vtkNew<vtkCellArray> cells;
  for (const glm::uvec3& t : mesh.triangles) {
    const std::array<vtkIdType, 3> ids = {t.x, t.y, t.z};
    cells->InsertNextCell(3, ids.data());
  }
  locator_->mesh->SetPoints(points);
  locator_->mesh->SetPolys(cells);
  locator_->cells->SetDataSet(locator_->mesh);
  locator_->cells->BuildLocator();
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

TriangleMesh plain_mesh(const MeshScene& scene) {
  TriangleMesh mesh;
  for (const SubMesh& part : scene.meshes) {
    const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
    mesh.positions_m.insert(mesh.positions_m.end(), part.positions_m.begin(),
                            part.positions_m.end());
    for (const glm::uvec3& t : part.triangles) mesh.triangles.push_back(t + first);
  }
  return mesh;
}

}  // namespace segsim::sim
