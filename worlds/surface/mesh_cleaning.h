#pragma once

/// @file
/// What a surface needs before anything collides with it: small pieces off, fewer triangles,
/// and answers to "is it closed?" and "where is it?".

#include <cstddef>
#include <vector>

#include <glm/vec3.hpp>

#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

/// Edges by the number of triangles that share them.
struct EdgeCounts {
  std::size_t inner = 0;      ///< Two triangles, in opposite directions.
  std::size_t open = 0;       ///< One: the surface ends here.
  std::size_t irregular = 0;  ///< More than two, or two in the same direction.

  [[nodiscard]] std::size_t total() const { return inner + open + irregular; }
};
[[nodiscard]] EdgeCounts count_edges(const sim::TriangleMesh& mesh);

/// Removes connected pieces (by shared vertices) whose triangles have less than `min_area_m2`
/// together, and vertices that nothing uses. @return  Pieces removed.
std::size_t remove_small_pieces(sim::TriangleMesh& mesh, double min_area_m2);

/// Fewer triangles (VTK's vtkDecimatePro: Schroeder et al. 1992): edges are collapsed as long
/// as no vertex moves the surface by more than `max_error_m`, summed over all collapses.
/// Neither tears nor joins the surface. Deterministic.
[[nodiscard]] sim::TriangleMesh decimated(const sim::TriangleMesh& mesh, double max_error_m);

struct SurfaceSamples {
  std::vector<glm::vec3> points_m;
  std::vector<glm::vec3> normals;  ///< Of their triangles; 0 for those without area.
};

/// Points on every triangle, at most `spacing_m` apart; at least one on each.
[[nodiscard]] SurfaceSamples sample_surface(const sim::TriangleMesh& mesh, double spacing_m);

/// Unit, on the side from which the vertices run counter-clockwise; 0 without area.
[[nodiscard]] glm::vec3 triangle_normal(const sim::TriangleMesh& mesh,
                                        const glm::uvec3& triangle);

}  // namespace segsim::worlds
