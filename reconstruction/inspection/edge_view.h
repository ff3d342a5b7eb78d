#pragma once

/// @file
/// Where colour and depth of one frame have edges. A depth camera that is calibrated against
/// the colour camera sees the border of a chair where the colour camera sees it.

#include <span>
#include <vector>

#include <glm/vec2.hpp>

#include "core/image.h"

namespace segsim::reconstruction {

struct EdgeView {
  /// How near the next edge in colour is: 255 on one, falling off within 3 pixels. Reduced to
  /// at most 320 pixels of width.
  core::Image<std::uint8_t> color_edge_nearness;
  std::vector<glm::vec2> depth_edges_px;  ///< In that image.
};

/// @param depth_m  Not empty; may have another size.
[[nodiscard]] EdgeView make_edge_view(const core::Image<core::Rgb8>& rgb,
                                      const core::Image<float>& depth_m);

/// A change of the depth image that would bring its edges onto those in colour.
struct EdgeShift {
  glm::dvec2 shift_px{0.0};  ///< Of the reduced image, after scaling.
  double scale = 1.0;        ///< About the image centre.
  double agreement = 0.0;    ///< Mean nearness of depth edges to colour edges, 0 to 1.

  /// Of a point half-way between image centre and left border, at most.
  [[nodiscard]] double displacement_px(int width_px) const;
};

struct EdgeFit {
  EdgeShift given;  ///< As the recording is calibrated.
  EdgeShift best;
  double elsewhere = 0.0;  ///< Agreement of the middle one of all shifts: what chance gives.
};

/// Tries shifts of up to 8 pixels and scales of up to 4 % on all views together.
[[nodiscard]] EdgeFit fit_edges(std::span<const EdgeView* const> views);

}  // namespace segsim::reconstruction
