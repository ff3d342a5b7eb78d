#pragma once

/// @file
/// Where the robot's centre may be: obstacles inflated by its circumscribed circle, with a
/// soft cost beyond. Distances come from an exact Euclidean transform between cell centres.

#include "nav/grid.h"
#include "nav/occupancy_map.h"

namespace segsim::nav {

struct CostMapOptions {
  double robot_radius_m = 0.33;  ///< Circumscribed circle of the Jackal (0.508 x 0.430 m).
  double margin_m = 0.02;        ///< Added to the radius.
  double mast_radius_m = 0.10;   ///< The mast keeps this distance from table tops.
  /// Unknown pockets below this area, counted where the robot's centre fits, are taken as
  /// free: the camera cannot see the floor near the robot. VLFM fills 1.5 m2 with an inflation
  /// of 0.15 m; with 0.35 m a small bathroom has less than that.
  double fill_pocket_m2 = 0.5;
  double soft_distance_m = 0.65;  ///< Obstacles nearer than this cost extra ...
  double soft_weight = 4.0;  ///< ... up to this multiple of the length, at the inflated edge.
  /// Take everything unknown as free (the "free-space assumption" of Koenig and Likhachev), at
  /// `unknown_cost` times the length: where to go when the known way does not lead there.
  bool cross_unknown = false;
  double unknown_cost = 2.0;
};

class CostMap {
 public:
  /// Computes everything from the observed part of the map (and some cells around it), so its
  /// frame is smaller than the map's. Cost linear in cells.
  void build(const OccupancyMap& map, const CostMapOptions& options);
  /// Builds from hand-made states (tests, other map sources). @param mast  Empty or equal
  /// size.
  void build(const GridFrame& frame, const core::Image<CellState>& body,
             const core::Image<std::uint8_t>& mast, const CostMapOptions& options);

  [[nodiscard]] const GridFrame& frame() const { return frame_; }
  [[nodiscard]] const CostMapOptions& options() const { return options_; }
  [[nodiscard]] CellState state(const Cell& cell) const;
  /// Free (or in a small unknown pocket) and far enough from obstacles; false outside of the
  /// map.
  [[nodiscard]] bool traversable(const Cell& cell) const;
  /// Not occupied, far enough from obstacles, seen or not; false outside of the map.
  [[nodiscard]] bool clear(const Cell& cell) const;
  /// To the nearest occupied cell (body layer) [m]; large if there is none.
  [[nodiscard]] float clearance_m(const Cell& cell) const;
  /// To the nearest thing that only the mast can hit [m]; large if there is none.
  [[nodiscard]] float mast_clearance_m(const Cell& cell) const;
  /// Multiple of the length that a traversable cell costs, >= 1.
  [[nodiscard]] float length_cost(const Cell& cell) const;

  [[nodiscard]] const core::Image<CellState>& states() const { return states_; }
  /// 1 where traversable() holds.
  [[nodiscard]] const core::Image<std::uint8_t>& traversable_cells() const {
    return traversable_;
  }
  /// 1 where clear() holds.
  [[nodiscard]] const core::Image<std::uint8_t>& clear_cells() const { return clear_; }
  /// length_cost() of every cell.
  [[nodiscard]] const core::Image<float>& length_costs() const { return cost_; }

 private:
  void finish(const core::Image<std::uint8_t>& mast);
  void fill_pockets();

  GridFrame frame_;
  CostMapOptions options_;
  core::Image<CellState> states_;
  core::Image<std::uint8_t> traversable_, clear_;
  core::Image<float> clearance_m_, mast_clearance_m_, cost_;
};

/// Distance from each cell centre to the nearest cell centre where `sources` is not 0 [m];
/// 1e6 everywhere if there is none.
[[nodiscard]] core::Image<float> distance_to_cells_m(const core::Image<std::uint8_t>& sources,
                                                     double resolution_m);

}  // namespace segsim::nav
