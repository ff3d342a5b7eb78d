#include "worlds/surface/mesh_cleaning.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

#include <vtkCellArray.h>
#include <vtkDecimatePro.h>
#include <vtkNew.h>
#include <vtkPolyData.h>

#include <glm/geometric.hpp>
#include "core/check.h"
#include "worlds/surface/internal/vtk_mesh.h"

namespace segsim::worlds {
namespace {

double area_m2(const sim::TriangleMesh& mesh, const glm::uvec3& t) {
  const glm::dvec3 a(mesh.positions_m[t.x]), b(mesh.positions_m[t.y]),
      c(mesh.positions_m[t.z]);
  return 0.5 * glm::length(glm::cross(b - a, c - a));
}

/// Groups of vertices that triangles connect (union by path halving).
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0U);
  }
  std::uint32_t root(std::uint32_t v) {
    while (parent_[v] != v) v = parent_[v] = parent_[parent_[v]];
    return v;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    if (a != b) parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

void drop_unused_vertices(sim::TriangleMesh& mesh) {
  constexpr std::uint32_t kUnused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> place(mesh.positions_m.size(), kUnused);
  std::vector<glm::vec3> kept;
  for (glm::uvec3& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) {
      std::uint32_t& to = place[t[i]];
      if (to == kUnused) {
        to = static_cast<std::uint32_t>(kept.size());
        kept.push_back(mesh.positions_m[t[i]]);
      }
      t[i] = to;
    }
  }
  mesh.positions_m = std::move(kept);
}

}  // namespace

EdgeCounts count_edges(const sim::TriangleMesh& mesh) {
  // An edge as (smaller vertex, larger vertex, direction).
  struct Edge {
    std::uint32_t a, b;
    bool forward;
  };
  std::vector<Edge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const glm::uvec3& t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) {
      const std::uint32_t from = t[i], to = t[(i + 1) % 3];
      edges.push_back({std::min(from, to), std::max(from, to), from < to});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& l, const Edge& r) {
    return std::tie(l.a, l.b, l.forward) < std::tie(r.a, r.b, r.forward);
  });
  EdgeCounts counts;
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i;
    while (end < edges.size() && edges[end].a == edges[i].a && edges[end].b == edges[i].b)
      ++end;
    if (end - i == 1) {
      ++counts.open;
    } else if (end - i == 2 && edges[i].forward != edges[i + 1].forward) {
      ++counts.inner;
    } else {
      ++counts.irregular;
    }
    i = end;
  }
  return counts;
}

std::size_t remove_small_pieces(sim::TriangleMesh& mesh, double min_area_m2) {
  Groups groups(mesh.positions_m.size());
  for (const glm::uvec3& t : mesh.triangles) {
    groups.join(t.x, t.y);
    groups.join(t.x, t.z);
  }
  std::vector<double> area(mesh.positions_m.size(), 0.0);
  for (const glm::uvec3& t : mesh.triangles) area[groups.root(t.x)] += area_m2(mesh, t);
  std::size_t removed = 0;
  std::vector<bool> counted(area.size(), false);
  std::vector<glm::uvec3> kept;
  for (const glm::uvec3& t : mesh.triangles) {
    const std::uint32_t root = groups.root(t.x);
    if (area[root] >= min_area_m2) {
      kept.push_back(t);
    } else if (!counted[root]) {
      counted[root] = true;
      ++removed;
    }
  }
  mesh.triangles = std::move(kept);
  drop_unused_vertices(mesh);
  return removed;
}

sim::TriangleMesh decimated(const sim::TriangleMesh& mesh, double max_error_m) {
  if (mesh.triangles.empty() || max_error_m <= 0.0) return mesh;
  const vtkNew<vtkPolyData> input = internal::to_vtk(mesh);
  vtkNew<vtkDecimatePro> filter;
  filter->SetInputData(input);
  filter->SetTargetReduction(0.98);
  filter->PreserveTopologyOn();
  filter->SplittingOff();
  filter->BoundaryVertexDeletionOff();  // Open edges stay where knowledge ended.
  filter->SetErrorIsAbsolute(1);
  filter->SetAbsoluteError(max_error_m);
  filter->AccumulateErrorOn();
  filter->Update();
  vtkPolyData* output = filter->GetOutput();
  sim::TriangleMesh result;
  for (vtkIdType i = 0; i < output->GetNumberOfPoints(); ++i) {
    glm::dvec3 p;
    output->GetPoint(i, &p.x);
    result.positions_m.emplace_back(p);
  }
  vtkIdType count = 0;
  const vtkIdType* ids = nullptr;
  vtkCellArray* triangles = output->GetPolys();
  for (triangles->InitTraversal(); triangles->GetNextCell(count, ids) != 0;) {
    result.triangles.emplace_back(static_cast<std::uint32_t>(ids[0]),
                                  static_cast<std::uint32_t>(ids[1]),
                                  static_cast<std::uint32_t>(ids[2]));
  }
  drop_unused_vertices(result);
  return result;
}

glm::vec3 triangle_normal(const sim::TriangleMesh& mesh, const glm::uvec3& triangle) {
  const glm::vec3& a = mesh.positions_m[triangle.x];
  const glm::vec3 n =
      glm::cross(mesh.positions_m[triangle.y] - a, mesh.positions_m[triangle.z] - a);
  const float length = glm::length(n);
  return length > 0.0F ? n / length : glm::vec3(0.0F);
}

SurfaceSamples sample_surface(const sim::TriangleMesh& mesh, double spacing_m) {
  SEGSIM_CHECK(spacing_m > 0.0, "spacing_m");
  SurfaceSamples samples;
  for (const glm::uvec3& t : mesh.triangles) {
    const glm::vec3 a = mesh.positions_m[t.x];
    const glm::vec3 u = mesh.positions_m[t.y] - a, v = mesh.positions_m[t.z] - a;
    const auto longest =
        static_cast<double>(std::max({glm::length(u), glm::length(v), glm::length(u - v)}));
    const int n = std::max(1, static_cast<int>(std::ceil(longest / spacing_m)));
    const auto share = [n](int i) {
      return (static_cast<float>(i) + 1.0F / 3.0F) / static_cast<float>(n);
    };
    const glm::vec3 normal = triangle_normal(mesh, t);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; i + j < n; ++j) {
        samples.points_m.push_back(a + share(i) * u + share(j) * v);
        samples.normals.push_back(normal);
      }
    }
  }
  return samples;
}

}  // namespace segsim::worlds
