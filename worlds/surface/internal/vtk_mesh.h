#pragma once

#include <array>

#include <vtkCellArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>

#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds::internal {

/// The mesh as VTK's filters take it, positions as float.
inline vtkNew<vtkPolyData> to_vtk(const sim::TriangleMesh& mesh) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToFloat();
  for (const glm::vec3& p : mesh.positions_m) points->InsertNextPoint(&p.x);
  vtkNew<vtkCellArray> cells;
  for (const glm::uvec3& t : mesh.triangles) {
    const std::array<vtkIdType, 3> ids = {t.x, t.y, t.z};
    cells->InsertNextCell(3, ids.data());
  }
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetPolys(cells);
  return data;
}

}  // namespace segsim::worlds::internal
