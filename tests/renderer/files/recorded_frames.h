#pragma once

/// @file
/// Frames with every image filled, for tests of files.

#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "core/frames.h"
#include "core/render.h"

namespace segsim::renderer::testing {

/// 16 x 16 pixels: every byte value of colour, ids up to 65535, a NaN depth.
inline core::Frame full_frame() {
  core::Frame frame;
  frame.intrinsics = {16, 16, 20.5, 21.25, 8.125, 7.75};
  frame.T_world_camera = core::look_at({1.0, 2.0, 1.5}, {3.0, -1.0, 0.5});
  frame.rgb = core::Image<core::Rgb8>(16, 16);
  frame.alpha = frame.depth_m = frame.confidence = core::Image<float>(16, 16);
  frame.instance_confidence = core::Image<float>(16, 16);
  frame.normal = frame.depth_normal = core::Image<glm::vec3>(16, 16);
  frame.semantic = frame.instance = core::Image<std::uint16_t>(16, 16);
  frame.semantic_feature = core::Image<core::SemanticFeature>(16, 16);
  frame.instance_feature = core::Image<core::InstanceFeature>(16, 16);
  for (std::size_t i = 0; i < 256; ++i) {
    const auto byte = static_cast<std::uint8_t>(i);
    frame.rgb.pixels()[i] = {byte, static_cast<std::uint8_t>(255 - i), 7};
    const auto x = static_cast<float>(i);
    frame.alpha.pixels()[i] = x / 255.0F;
    frame.depth_m.pixels()[i] =
        i == 17 ? std::numeric_limits<float>::quiet_NaN() : 0.0123456F * x;
    frame.confidence.pixels()[i] = 1.0F - x / 255.0F;
    frame.instance_confidence.pixels()[i] = x / 1000.0F;
    frame.normal.pixels()[i] = glm::normalize(glm::vec3(x, 1.0F, -2.0F));
    frame.depth_normal.pixels()[i] = glm::normalize(glm::vec3(-1.0F, x, 3.0F));
    frame.semantic.pixels()[i] = byte;
    frame.instance.pixels()[i] = static_cast<std::uint16_t>(257 * i);
    for (std::size_t k = 0; k < core::kSemanticFeatureSize; ++k) {
      frame.semantic_feature.pixels()[i][k] = std::sin(x + static_cast<float>(k));
    }
    for (std::size_t k = 0; k < core::kInstanceFeatureSize; ++k) {
      frame.instance_feature.pixels()[i][k] = 10.0F * std::cos(x - static_cast<float>(k));
    }
  }
  return frame;
}

}  // namespace segsim::renderer::testing
