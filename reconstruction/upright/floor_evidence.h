#pragma once

/// @file
/// Where the floor is, from what a recording shows: the lowest large level surface that
/// cameras stand above and that walls do not pass. Where it was not seen, it is guessed from
/// the height at which walls end.

#include <optional>
#include <span>

#include "reconstruction/upright/surface_elements.h"

namespace segsim::reconstruction {

struct FloorEvidence {
  double height_m = 0.0;      ///< Of the frame's z.
  bool guessed = false;       ///< Not seen: walls end here.
  double area_m2 = 0.0;       ///< Seen of it.
  double camera_share = 0.0;  ///< Of the cameras: 0.25 to 2.5 m above it.
  double wall_share = 0.0;    ///< Of the walls: they end near it.
};

/// @param elements  In a frame with z up.
/// @param camera_heights_m  In that frame.
/// @return  nullopt if no level surface is below the cameras and walls do not agree on an end.
[[nodiscard]] std::optional<FloorEvidence> find_floor_evidence(
    std::span<const SurfaceElement> elements, std::span<const double> camera_heights_m);

}  // namespace segsim::reconstruction
