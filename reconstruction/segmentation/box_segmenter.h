#pragma once

/// @file
/// From the box of a detection to the pixels of the object, by depth discontinuities and
/// colour; no network.
///
///     depth --steps--> connected regions; floor, walls and ceiling (room_parts.h) are none
///     box --> the region that fills its middle and lies in it, and others at its depth
///         --> certain and likely pixels of object and surroundings
///         --> GrabCut (Rother et al. 2004) on colour decides the likely ones
///
/// Where depth says nothing (black or shiny surfaces), the middle of the box is likely object
/// and colour alone decides.

#include <cstdint>
#include <vector>

#include "core/image.h"
#include "core/stages.h"
#include "reconstruction/segmentation/room_parts.h"

namespace segsim::reconstruction {

struct BoxSegmenterOptions {
  /// Neighbouring pixels are one surface if their depths differ by less than this share.
  double depth_step = 0.03;
  int bridge_px = 3;           ///< Holes of the depth image that are narrower are bridged.
  double grow = 0.06;          ///< The object may leave the box by this share of its sides.
  double inside_share = 0.6;   ///< Of a region in the box: it is the object's.
  double foreign_share = 0.3;  ///< Less of a region in the box: it is something else's.
  double depth_margin = 0.3;  ///< Of other regions from the object's depths, in box diagonals.
  int rounds = 3;             ///< Of GrabCut.
  int longest_px = 160;       ///< Boxes are segmented at most this large, then scaled up.
  double least_fill = 0.08;   ///< Of the box; smaller masks are none.
};

/// Segments boxes of one view. Equal inputs give equal masks, on any number of threads.
class BoxSegmenter {
 public:
  /// Images of equal size.
  /// @param depth_m  Along +z; NaN = unknown. May be empty: no depth at all.
  /// @param parts  Floor, walls and ceiling of the view; may be empty.
  /// @param focal_px  Of the camera.
  BoxSegmenter(const core::Image<core::Rgb8>& rgb, const core::Image<float>& depth_m,
               const core::Image<RoomPart>& parts, double focal_px,
               const BoxSegmenterOptions& options = {});

  /// @param box  In pixels of the image; may reach beyond it.
  /// @return  1 inside, of the image's size; all 0 if nothing was found.
  [[nodiscard]] core::Image<std::uint8_t> segment(const core::BoxPx& box) const;

  /// Connected surfaces of the depth image that are no part of the room: 0 = none, else from 1
  /// in the order of their first pixels.
  [[nodiscard]] const core::Image<std::int32_t>& regions() const { return region_; }

 private:
  const core::Image<core::Rgb8>& rgb_;
  core::Image<float> depth_m_;  ///< With small holes filled; NaN = unknown.
  core::Image<RoomPart> parts_;
  double focal_px_;
  BoxSegmenterOptions options_;
  core::Image<std::int32_t> region_;
  std::vector<std::int64_t> region_px_;  ///< By id.
};

}  // namespace segsim::reconstruction
