#pragma once

/// @file
/// A scene seen from above: the background of trial pictures and videos.

#include <glm/vec2.hpp>

#include "core/image.h"
#include "renderer/scene/surfels.h"

namespace segsim::experiments::drawing {

/// Image of the floor, +x to the right and +y up: world point p lies at pixel
/// ((p.x - origin.x) px_per_m, height - (p.y - origin.y) px_per_m).
struct FloorPlan {
  core::Image<core::Rgb8> rgb;
  glm::dvec2 origin_m{0.0};  ///< World position of the image's lower left corner.
  double px_per_m = 0.0;

  [[nodiscard]] glm::dvec2 to_px(const glm::dvec2& p_m) const {
    return {(p_m.x - origin_m.x) * px_per_m,
            rgb.height_px() - (p_m.y - origin_m.y) * px_per_m};
  }
};

/// Orthographic view from above of the surfels below `max_height_m` (so without the ceiling),
/// the highest in front. The extent leaves out stray surfels: the outermost 0.1 % on each
/// side.
[[nodiscard]] FloorPlan make_floor_plan(const renderer::SurfelCloud& surfels,
                                        double max_height_m = 1.8, double px_per_m = 64.0);

}  // namespace segsim::experiments::drawing
