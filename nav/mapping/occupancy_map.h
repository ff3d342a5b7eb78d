#pragma once

/// @file
/// Growing log-odds grid from depth images: the floor seen, the obstacles hit, and the cells
/// that a ray passed through at a height at which it would have met the obstacle stored there.
///
/// The camera sits on a mast and does not see the floor near the robot. A ray above a low
/// table says nothing about the table, so clearing looks at heights: a ray clears an occupied
/// cell only if it passes below the top of the obstacle, and makes an unknown cell free only
/// if it passes below `pass_height_m`. Floor seen in the very cell contradicts low obstacles.
///
/// Depth cameras blend fore- and background at edges ("flying pixels"), which puts specks into
/// doors; such pixels are no hits. Where the image has no depth although the floor should be
/// there, with nothing known in between, a few such views make an unknown cell presumed free:
/// dark or unreconstructed floor would otherwise never be crossed.
///
/// Two layers: what the body can hit (`obstacle_min_m` .. `obstacle_max_m`) and what only the
/// mast can hit (table tops, from there up to the camera). Differs from VLFM, whose cells are
/// never cleared (Quirk::kObstaclesStay) and whose single band is 0.61 .. 0.88 m.

#include <cstdint>

#include "core/stages.h"
#include "nav/grid/grid_layer.h"
#include "nav/grid/growing_frame.h"
#include "nav/mapping/view_cells.h"

namespace segsim::nav {

struct OccupancyOptions {
  GrowthOptions growth;  ///< Never wraps.
  double obstacle_min_m =
      0.10;  ///< Lower points are floor; wheels of 0.1 m radius pass sills.
  double obstacle_max_m = 0.60;  ///< Body and payload; higher points concern the mast only.
  double mast_above_camera_m = 0.05;  ///< The mast ends this far above the camera.
  double max_range_m = 5.0;           ///< Planar range used for mapping; VLFM's depth limit.
  double pass_height_m = 0.40;        ///< See above; chair seats and beds are higher.
  double footprint_radius_m = 0.33;   ///< Circle that holds the robot; the Jackal's.
  double inside_radius_m = 0.65 * 0.33;  ///< Circle inside the robot: surely free.
  /// Cells around the very first pose are assumed free up to this radius until seen otherwise:
  /// the camera cannot see them. 0: up to where the lowest image ray falls to `pass_height_m`.
  double start_free_radius_m = 0.0;
  /// Never observed cells this near to the robot's path are assumed free until seen otherwise.
  double near_free_radius_m = 0.55;
  int min_hits_per_cell = 2;  ///< Points of one image that make a hit; one is a stray.
  /// ... and this share of the points that a facing square of one cell would get.
  double hit_share = 0.25;
  /// Very near, where the body's band lies below the image, only the upper part of a wall is
  /// in view: what extends over this height in a cell is taken to stand on the floor. A table
  /// top is flat, and the body passes below it: with 0.2 m narrow places between tables stay
  /// open, at the price of contacts with what is not seen there from so near.
  double wall_part_m = 0.0;
  bool reject_flying_pixels = true;
  double hole_range_m = 4.0;  ///< Missing depth within this range of the floor is a hole;
  int hole_views = 3;  ///< seen so often, its unknown cells are presumed free. 0: never.
  /// Every n-th pixel is traced for clearing; of large images, more: about 128 x 64 rays.
  int ray_step_x_px = 2, ray_step_y_px = 3;
  float log_odds_hit = 0.7F, log_odds_miss = 0.35F;
  float log_odds_min = -1.5F, log_odds_max = 2.5F;
  float occupied_above = 0.5F;  ///< Log-odds; one hit makes an unknown cell occupied.
  float free_below = -0.15F;    ///< Log-odds; one miss makes an unknown cell free.
};

class OccupancyMap {
 public:
  /// @throws ContractViolation for options out of range.
  explicit OccupancyMap(const OccupancyOptions& options = {});

  /// Forgets everything.
  void reset();
  /// Fuses one depth image; pixels that are NaN, infinite or <= 0 are skipped. The map grows
  /// as needed. Also marks the robot's footprint free. Of images from 640 px on every n-th
  /// pixel is used (thinning_of()).
  /// @throws ContractViolation if the depth image is missing or of another size than the
  /// intrinsics.
  void integrate(const core::Observation& observation);
  /// Marks cells whose centre lies within `radius_m` as free for body and mast.
  void mark_free_disc(const glm::dvec2& center_odom_m, double radius_m);
  /// Marks cells whose centre lies within `radius_m` as an obstacle that no ray can clear:
  /// something was touched there which the camera does not see.
  void mark_blocked_disc(const glm::dvec2& center_odom_m, double radius_m);
  /// Takes all of that back: the cells count as never observed.
  void forget_blocked();

  [[nodiscard]] const GridFrame& frame() const { return frame_; }
  /// Something lay farther away than the map may grow; it was left out.
  [[nodiscard]] bool exhausted() const { return exhausted_; }
  /// Holds every cell that ever said something about the body layer, in the frame of now.
  [[nodiscard]] CellBox observed() const;
  /// Holds every cell that may have changed since the last call, in the frame of now.
  [[nodiscard]] CellBox take_changed();
  [[nodiscard]] const OccupancyOptions& options() const { return options_; }
  /// State for the robot's body; unknown outside of the map.
  [[nodiscard]] CellState body_state(const Cell& cell) const;
  /// Log-odds of the two layers, 0 = never observed. [width_cells x height_cells]
  [[nodiscard]] const GridLayer<float>& body_log_odds() const { return body_; }
  [[nodiscard]] const GridLayer<float>& mast_log_odds() const { return mast_; }

 private:
  static constexpr float kBlocked = 100.0F;     ///< Log-odds of what was touched: for ever.
  static constexpr float kAssumedFree = -0.2F;  ///< Free, but one hit makes it occupied.

  /// Grows the map to hold the box; false, and nothing done, if it may not grow so far.
  [[nodiscard]] bool ensure_covers(const glm::dvec2& low_m, const glm::dvec2& high_m);
  void note_changed(const Cell& cell);
  void assume_free_disc(const glm::dvec2& center_odom_m, double radius_m);

  // occupancy_fusion.cpp: one image.
  void fuse_image(const core::Image<float>& depth_m, const MappingCamera& camera);
  void note_holes(const core::Image<float>& depth_m, const MappingCamera& camera);
  [[nodiscard]] bool hidden_by_obstacle(const MappingCamera& camera,
                                        const glm::dvec3& direction, double range_m) const;
  void fuse_view(const MappingCamera& camera);
  /// What a view says about one cell.
  struct CellView {
    ViewCells::Hits hits;
    int floor_hits;
    bool passed_low, through_body, through_mast;
  };
  void fuse_body(const Cell& at, const CellView& cell, int hits_needed, bool below_unseen,
                 HitHeights& stored);
  /// Whether the hits may be the upper part of what stands on the floor.
  [[nodiscard]] bool like_a_wall(const HitHeights& heights) const {
    return static_cast<double>(heights.mast_top_m - heights.mast_low_m) >=
           options_.wall_part_m;
  }
  void fuse_mast(const Cell& at, const CellView& cell, int hits_needed, HitHeights& stored);
  void fuse_hole(const Cell& at, const CellView& cell);

  OccupancyOptions options_;
  GridFrame frame_;
  GridLayer<float> body_, mast_;       ///< Log-odds.
  GridLayer<std::uint8_t> obstacles_;  ///< 1 where heights are stored.
  GridLayer<HitHeights> heights_;      ///< Holds nothing elsewhere.
  GridLayer<std::uint8_t> hole_views_;
  bool started_ = false, exhausted_ = false;
  /// On the lattice of GridFrame, so that growth shifts nothing.
  CellBox observed_, changed_;
  core::Image<float> thinned_m_;  ///< Scratch.
  ViewCells view_;                ///< Scratch: of the image being fused.
};

}  // namespace segsim::nav
