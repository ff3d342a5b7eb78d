#include "worlds/surface/voxel_faces.h"

#include <algorithm>

namespace segsim::worlds {
namespace {

/// A rectangle at `plane_m` along `axis`; u and v are the next two axes in turn, so u x v =
/// axis.
void append_face(int axis, bool positive, double plane_m, const glm::dvec2& lo_m,
                 const glm::dvec2& hi_m, sim::TriangleMesh& mesh) {
  const int u = (axis + 1) % 3;
  const int v = (axis + 2) % 3;
  const auto base = static_cast<std::uint32_t>(mesh.positions_m.size());
  const glm::dvec2 corners[4] = {lo_m, {hi_m.x, lo_m.y}, hi_m, {lo_m.x, hi_m.y}};
  for (const glm::dvec2& corner : corners) {
    glm::vec3 p;
    p[axis] = static_cast<float>(plane_m);
    p[u] = static_cast<float>(corner.x);
    p[v] = static_cast<float>(corner.y);
    mesh.positions_m.push_back(p);
  }
  const std::uint32_t second = positive ? 1 : 3;
  const std::uint32_t fourth = positive ? 3 : 1;
  mesh.triangles.emplace_back(base, base + second, base + 2);
  mesh.triangles.emplace_back(base, base + 2, base + fourth);
}

}  // namespace

std::vector<CellRectangle> merge_cells(sim::GridMask& mask) {
  std::vector<CellRectangle> rectangles;
  for (int j = 0; j < mask.height_px(); ++j) {
    for (int i = 0; i < mask.width_px(); ++i) {
      if (mask(i, j) == 0) continue;
      CellRectangle r{i, j, i + 1, j + 1};
      while (r.i1 < mask.width_px() && mask(r.i1, j) != 0) ++r.i1;
      const auto full = [&](int row) {
        return std::all_of(mask.row(row) + r.i0, mask.row(row) + r.i1,
                           [](std::uint8_t value) { return value != 0; });
      };
      while (r.j1 < mask.height_px() && full(r.j1)) ++r.j1;
      for (int row = r.j0; row < r.j1; ++row)
        std::fill(mask.row(row) + r.i0, mask.row(row) + r.i1, std::uint8_t{0});
      rectangles.push_back(r);
    }
  }
  return rectangles;
}

void append_exposed_faces(const VoxelBox& voxels, sim::TriangleMesh& mesh) {
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3;
    const int v = (axis + 2) % 3;
    for (const int side : {-1, 1}) {
      for (int layer = 0; layer < voxels.size[axis]; ++layer) {
        sim::GridMask mask(voxels.size[u], voxels.size[v], 0);
        bool any = false;
        for (int b = 0; b < voxels.size[v]; ++b) {
          for (int a = 0; a < voxels.size[u]; ++a) {
            glm::ivec3 here;
            here[axis] = layer;
            here[u] = a;
            here[v] = b;
            glm::ivec3 next = here;
            next[axis] += side;
            if (voxels.at(here) && !voxels.at(next)) {
              mask(a, b) = 1;
              any = true;
            }
          }
        }
        if (!any) continue;
        const double plane_m =
            voxels.origin_m[axis] + voxels.cell_m * (layer + (side > 0 ? 1 : 0));
        const glm::dvec2 origin(voxels.origin_m[u], voxels.origin_m[v]);
        for (const CellRectangle& r : merge_cells(mask)) {
          append_face(axis, side > 0, plane_m, origin + voxels.cell_m * glm::dvec2(r.i0, r.j0),
                      origin + voxels.cell_m * glm::dvec2(r.i1, r.j1), mesh);
        }
      }
    }
  }
}

}  // namespace segsim::worlds
