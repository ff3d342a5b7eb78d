#pragma once

/// @file
/// What one depth image says about the cells in range of the camera, before a map fuses it: in
/// which cells its pixels end and at what height, and how low its rays pass over the others.
///
/// A square window of cells around the eye, one array per question, so that the array of the
/// rays stays in the nearest cache. Positions are relative to the window: what a view says
/// does not depend on how far the map has grown.

#include <cstdint>
#include <vector>

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

#include "core/stages.h"
#include "nav/grid/grid_layer.h"
#include "nav/mapping/internal/set_bytes.h"
#include "nav/mapping/obstacle_horizon.h"

namespace segsim::nav {

/// Heights between which the obstacle of each layer was hit, above the floor [m].
struct HitHeights {
  float body_low_m = 1e3F, body_top_m = -1.0F;
  float mast_low_m = 1e3F, mast_top_m = -1.0F;
  /// Whether anything was hit.
  [[nodiscard]] bool any() const {
    return body_low_m != HitHeights{}.body_low_m || mast_low_m != HitHeights{}.mast_low_m;
  }
};

/// The camera of one observation, with heights above the robot's floor.
struct MappingCamera {
  core::CameraIntrinsics intrinsics;
  glm::dmat3 R_odom_camera{1.0};
  glm::dvec3 eye_m{0.0};  ///< Odom, z above the floor.
  glm::dvec2 robot_m{0.0};

  explicit MappingCamera(const core::Observation& observation);
  /// Of a pixel's ray, one metre along the optical axis.
  [[nodiscard]] glm::dvec3 direction(double u_px, double v_px) const {
    return R_odom_camera * glm::dvec3((u_px - intrinsics.cx_px) / intrinsics.fx_px,
                                      (v_px - intrinsics.cy_px) / intrinsics.fy_px, 1.0);
  }
  /// Planar distance at which the image's bottom ray falls to a height; 0 if it starts below.
  [[nodiscard]] double range_where_lowest_ray_is_at(double height_m) const;
};

/// Heights above the floor and ranges that sort an image's points [m].
struct ViewLimits {
  double obstacle_min_m, obstacle_max_m;  ///< The body's band.
  double mast_top_m;                      ///< The mast's band ends here.
  double max_range_m;                     ///< In the plane.
  double pass_height_m;                   ///< Lower rays say that a cell is free.
  bool reject_flying_pixels;
};

class ViewCells {
 public:
  /// Points of one image that ended in a cell.
  struct Hits {
    std::uint16_t body = 0, mast = 0;
    HitHeights heights;
  };
  enum Mark : std::uint8_t {
    kObstacle = 1,       ///< Heights of a hit are stored in the map.
    kSaysSomething = 2,  ///< Anything but high rays.
    kHit = 4,            ///< hits() is of this image.
    kThroughBody = 8,    ///< A ray met no stored obstacle of the body's layer,
    kThroughMast = 16,   ///< of the mast's.
    kHole = 32,          ///< Floor without depth.
    kPassedLow = 64      ///< A ray or the floor was seen at most `pass_height_m` up.
  };

  /// Places the window around the eye, two cells more than the range on each side, and forgets
  /// the last image. @param obstacles  1 where the map stores heights; covers the window.
  void open(const GridFrame& frame, const GridLayer<std::uint8_t>& obstacles,
            const MappingCamera& camera, const ViewLimits& limits);
  /// Every pixel: which cell does it end in, and at what height?
  void mark_end_points(const core::Image<float>& depth_m, const MappingCamera& camera);
  /// Every n-th pixel's ray: which cells does it pass, and how low?
  /// @param stored  Of the map, in its own frame.
  void trace_rays(const core::Image<float>& depth_m, const MappingCamera& camera,
                  const GridLayer<HitHeights>& stored, int step_x_px, int step_y_px);

  /// Cell of the map that is the window's first.
  [[nodiscard]] const Cell& low() const { return low_; }
  [[nodiscard]] int side() const { return marks_.width_px(); }
  /// Index of a cell of the map, for the queries below.
  [[nodiscard]] std::size_t index(const Cell& cell) const {
    return static_cast<std::size_t>(cell.y - low_.y) * static_cast<std::size_t>(side()) +
           static_cast<std::size_t>(cell.x - low_.x);
  }
  /// Calls `visit(cell of the map, index)` for the cells about which this image says anything.
  template <class Visit>
  void for_each_told(const Visit& visit) const {
    for (int j = 0; j < side(); ++j) {
      internal::for_each_set(marks_.row(j), static_cast<std::size_t>(side()), kSaysSomething,
                             [&](std::size_t i) {
                               const Cell cell = low_ + Cell(static_cast<int>(i), j);
                               visit(cell, index(cell));
                             });
    }
  }
  [[nodiscard]] bool has(std::size_t index, Mark mark) const {
    return (marks_.data()[index] & mark) != 0;
  }
  [[nodiscard]] Hits hits(std::size_t index) const {
    return has(index, kHit) ? hits_.data()[index] : Hits{};
  }
  /// Points on the floor.
  [[nodiscard]] int floor_hits(std::size_t index) const { return floor_hits_.data()[index]; }
  void mark_hole(std::size_t index) { marks_.data()[index] |= kHole | kSaysSomething; }

 private:
  void note_hit(std::size_t index, float height_m);
  void trace_ray(const MappingCamera& camera, const glm::dvec3& direction, double depth_m,
                 const GridLayer<HitHeights>& stored);
  void note_obstacle(std::int32_t cell, float height_m, const GridLayer<HitHeights>& stored);

  ViewLimits limits_{};
  double resolution_m_ = 0.05;
  Cell low_{0};
  glm::vec2 eye_cells_{0.0F};  ///< In the window.
  core::Image<std::uint8_t> marks_;
  core::Image<std::uint16_t> floor_hits_;
  core::Image<Hits> hits_;
  ObstacleHorizon horizon_;              ///< Of the cells marked as obstacles.
  std::vector<std::int32_t> ray_cells_;  ///< Scratch of one ray: its cells,
  std::vector<std::int32_t> ray_met_;    ///< which of them hold an obstacle.
};

}  // namespace segsim::nav
