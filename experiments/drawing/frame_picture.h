#pragma once

/// @file
/// Rendered channels as pictures for people.

#include <cstdint>

#include "core/image.h"
#include "core/render.h"

namespace segsim::experiments::drawing {

/// A colour per id, far apart for neighbouring ids; 0 is dark grey. Equal everywhere in the
/// program.
[[nodiscard]] core::Rgb8 id_color(std::uint16_t id);

/// Near = warm, far = cold; invalid = black. @param max_m  Depth of the coldest colour.
[[nodiscard]] core::Image<core::Rgb8> depth_picture(const core::Image<float>& depth_m,
                                                    double max_m = 6.0);
/// Classes as colours; pixels of instances shaded by instance, instance borders white.
[[nodiscard]] core::Image<core::Rgb8> panoptic_picture(const core::Frame& frame);
/// x, y, z mapped to red, green, blue.
[[nodiscard]] core::Image<core::Rgb8> normal_picture(const core::Image<glm::vec3>& normal);

/// Colour | depth over normals | panoptic.
[[nodiscard]] core::Image<core::Rgb8> frame_picture(const core::Frame& frame);

}  // namespace segsim::experiments::drawing
