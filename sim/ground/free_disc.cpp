#include "sim/ground/free_disc.h"

#include <algorithm>

#include "sim/ground/collision.h"
#include "sim/ground/ground_grid.h"

namespace segsim::sim {

std::optional<core::FreeDisc> largest_free_disc(const TriangleMesh& mesh, double lowest_m,
                                                double highest_m) {
  if (mesh.positions_m.empty()) return std::nullopt;
  constexpr double kCell_m = CollisionWorld::kCell_m;
  // Cells around the mesh, so that its edge bounds the disc.
  const GridFrame frame = grid_over(mesh, kCell_m, 2.0 * kCell_m);
  GridMask occupied(frame.width, frame.height, 0);
  mark_floor(mesh, lowest_m, frame, occupied);
  for (std::uint8_t& cell : occupied.pixels()) cell = cell == 0 ? 1 : 0;
  mark_band(mesh, lowest_m, highest_m, frame, occupied);
  const core::Image<float> distance_m = distance_to_marked(occupied, kCell_m);
  const auto most = std::max_element(distance_m.pixels().begin(), distance_m.pixels().end());
  if (*most <= 0.0F) return std::nullopt;
  const auto index = static_cast<int>(most - distance_m.pixels().begin());
  // An obstacle begins at the edge of its cell.
  return core::FreeDisc{frame.center_m(index % frame.width, index / frame.width),
                        static_cast<double>(*most) - 0.5 * kCell_m};
}

}  // namespace segsim::sim
