#pragma once

/// @file
/// Where the robot's centre may be, and how far it is from there to the nearest goal.
///
/// Dijkstra over 32 directions on 5 cm cells: the longest detour of the lattice is 1.3 % (half
/// the widest angle between two directions is 9.2 degrees, 1 / cos 9.2). Several goals cost
/// one run.

#include <cstdint>
#include <span>
#include <vector>

#include <glm/vec2.hpp>

#include "sim/ground/collision.h"
#include "sim/ground/ground_grid.h"

namespace segsim::sim {

/// Cells where a disc robot fits at every heading.
struct FreeSpace {
  static constexpr double kCell_m = 0.05;

  GridFrame frame;
  GridMask free;
  core::Image<std::int32_t> island;  ///< From 1 by descending area; 0 = not free.
  double radius_m = 0.0;             ///< Of the disc.

  [[nodiscard]] bool is_free(const glm::dvec2& p_m) const;
  /// Island of the cell at a point; 0 if it is not free.
  [[nodiscard]] int island_at(const glm::dvec2& p_m) const;
  /// Nearest free cell with its centre within `reach_m`; (-1, -1) if there is none. Ties: row
  /// order.
  /// @param only_island  0 = any.
  [[nodiscard]] glm::ivec2 nearest_free(const glm::dvec2& p_m, double reach_m,
                                        int only_island = 0) const;
  [[nodiscard]] double area_m2(int of_island = 0) const;
};

/// Erodes by the circumscribed radius (base) and the mast's radius (mast).
/// @param margin_m  Added to both radii.
[[nodiscard]] FreeSpace make_free_space(const CollisionWorld& obstacles,
                                        double margin_m = 0.0);

/// Geodesic distance to the nearest of several goals. Keeps a reference to the free space.
class DistanceField {
 public:
  static constexpr double kSnap_m = 0.15;
  /// From where a base stands: one that touches nothing may stand up to (circumscribed -
  /// inscribed radius) outside the free space of a disc; plus a cell. Far less than the
  /// thickness of two radii that separates rooms.
  static constexpr double kBaseSnap_m = 0.30;

  /// Goals that are not in free space count from their nearest free cell within `goal_snap_m`
  /// (plus the way to it), or not at all.
  DistanceField(const FreeSpace& space, std::span<const glm::dvec2> goals_m,
                double goal_snap_m = kSnap_m);

  /// From a point: bilinear among free cells, or from the nearest free cell within `snap_m`
  /// plus the way to it. Infinity if there is none or no goal can be reached.
  [[nodiscard]] double at(const glm::dvec2& p_m, double snap_m = kSnap_m) const;
  /// Corners of a way to the nearest goal, shortened by line of sight; empty if there is none.
  [[nodiscard]] std::vector<glm::dvec2> path_from(const glm::dvec2& p_m,
                                                  double snap_m = kSnap_m) const;
  [[nodiscard]] const core::Image<float>& cells_m() const { return distance_m_; }
  [[nodiscard]] const FreeSpace& space() const { return *space_; }

 private:
  const FreeSpace* space_;
  core::Image<float> distance_m_;
  core::Image<std::int32_t>
      next_;  ///< Index of the next cell towards the goal; itself at a goal.
  core::Image<std::int32_t> goal_;  ///< Which goal a cell leads to; -1 = none.
  std::vector<glm::dvec2> goals_m_;
};

}  // namespace segsim::sim
