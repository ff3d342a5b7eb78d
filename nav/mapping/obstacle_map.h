#pragma once

/// @file
/// VLFM's map of obstacles, navigable cells and explored area,
/// in metres and frame Odom, with its frontiers.
///
/// Two rules for obstacles. As published (quirk Q4) a pixel whose point lies in the height
/// band occupies its cell for ever. Fixed, the log-odds of nav/mapping/occupancy_map.h decide,
/// which rays clear again; what only the mast can hit is then a layer of its own. Navigable is
/// what is left after growing obstacles by a square of k x k cells, k = int(2 radius / cell),
/// made odd.
///
/// The map grows with what is seen up to GrowthOptions::max_extent_m and then reports
/// `exhausted`; with Q9 published it is a fixed square whose negative indices wrap.

#include <optional>

#include "core/stages.h"
#include "nav/grid/grid_layer.h"
#include "nav/grid/growing_frame.h"
#include "nav/mapping/contour_frontiers.h"
#include "nav/mapping/depth_cleanup.h"
#include "nav/mapping/fog_of_war.h"
#include "nav/mapping/occupancy_map.h"

namespace segsim::nav {

struct ObstacleMapOptions {
  GrowthOptions growth;      ///< Used unless Q9 is published.
  double band_min_m = 0.61;  ///< Heights of obstacles above the floor; VLFM: 0.61 .. 0.88,
  double band_max_m = 0.88;  ///< for a camera at 0.88 m. A robot's profile sets them.
  double robot_radius_m = 0.18;
  double mast_radius_m = 0.10;  ///< Log-odds rule only.
  DepthCleanupOptions depth;
  FogOptions fog;  ///< Its opening is the camera's.
  ContourFrontierOptions frontiers;
  OccupancyOptions occupancy;  ///< Log-odds rule only; band and range are taken from here.
  /// Not in VLFM, log-odds rule only: where the robot stands inside of the inflation the
  /// sector reveals nothing; what was measured to be free counts as explored then.
  bool measured_where_enclosed = false;
};

class ObstacleMap {
 public:
  explicit ObstacleMap(const ObstacleMapOptions& options = {},
                       const VlfmRules& rules = VlfmRules());
  void reset();
  /// Fuses one image: obstacles, navigable cells, explored area.
  void update(const core::Observation& observation);
  /// Adds an obstacle that was felt, not seen.
  void mark_blocked_disc(const glm::dvec2& center_odom_m, double radius_m);
  /// Takes back what was felt (log-odds rule only), from the next image on.
  void forget_blocked() {
    if (occupancy_) occupancy_->forget_blocked();
  }

  [[nodiscard]] const GridFrame& frame() const { return frame_; }
  /// The smallest box that holds all occupied and explored cells.
  [[nodiscard]] CellBox observed() const;
  /// Holds every cell that may have changed since the last call, in the frame of now.
  [[nodiscard]] CellBox take_changed();
  [[nodiscard]] const GridLayer<std::uint8_t>& occupied() const { return occupied_; }
  /// Cells only the mast can hit; empty with the monotone rule.
  [[nodiscard]] const GridLayer<std::uint8_t>& mast() const { return mast_; }
  [[nodiscard]] const GridLayer<std::uint8_t>& navigable() const { return navigable_; }
  [[nodiscard]] const GridLayer<std::uint8_t>& explored() const { return explored_; }
  [[nodiscard]] std::vector<ContourFrontier> frontiers() const {
    return find_contour_frontiers(frame_, explored_, navigable_, options_.frontiers,
                                  observed());
  }
  /// Something lay beyond the largest extent (or, wrapping, beyond the last index).
  [[nodiscard]] bool exhausted() const { return exhausted_; }
  [[nodiscard]] const ObstacleMapOptions& options() const { return options_; }

 private:
  void ensure_covers(const glm::dvec2& robot_m);
  void mark_monotone(const core::Observation& observation);
  CellBox take_log_odds(const core::Observation& observation);
  [[nodiscard]] Cell shift_of(const OccupancyMap& map) const;
  void update_navigable(const Cell& low, const Cell& high);
  void reveal(const core::Observation& observation);
  void reveal_measured(const CellBox& box);
  void keep_component_of(const glm::dvec2& robot_m);
  void note_changed(const CellBox& cells);

  ObstacleMapOptions options_;
  VlfmRules rules_;
  std::optional<OccupancyMap> occupancy_;
  GridFrame frame_;
  GridLayer<std::uint8_t> occupied_, mast_, navigable_, explored_;
  core::Image<float> depth_m_, thinned_m_;  ///< Scratch.
  bool exhausted_ = false;
  CellBox touched_, changed_;  ///< Ever, and since the last call; on the lattice.
};

/// Side of the square that grows obstacles, in cells: int(2 radius / cell), plus 1 if even.
[[nodiscard]] int navigable_kernel_cells(double robot_radius_m, double resolution_m);

}  // namespace segsim::nav
