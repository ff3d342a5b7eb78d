#pragma once

/// @file
/// One RGB-D frame -> trustworthy surface samples.

#include <cstdint>
#include <vector>

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/lifting/lifting.h"

namespace segsim::reconstruction::internal {

/// Class in the upper, instance in the lower half: one vote decides both.
using LabelPair = std::uint32_t;
[[nodiscard]] constexpr LabelPair label_pair(std::uint16_t class_id,
                                             std::uint16_t instance_id) {
  return (static_cast<LabelPair>(class_id) << 16U) | instance_id;
}

/// So many frames are read and lifted at once.
inline constexpr std::size_t kFramesInMemory = 8;

/// What one depth pixel says about the surface.
struct LiftSample {
  glm::vec3 position_m;  ///< World frame.
  glm::vec3 normal;      ///< World frame, unit, towards the camera.
  glm::vec3 color;       ///< sRGB [0, 1].
  float weight;        ///< cos(angle of incidence) / z^2: inverse variance of a depth camera,
                       ///< if what measured depth was not stated.
  float color_weight;  ///< Falls faster with the angle: frontal views keep the texture sharp.
  LabelPair label;
};

struct FrameSamples {
  std::vector<LiftSample> samples;  ///< Row by row.
  std::uint64_t pixels_valid = 0, pixels_dropped = 0;
};

/// Drops pixels at depth edges (most of the neighbourhood lies elsewhere) and grazing ones:
/// the ramps of flying pixels between two surfaces point along the line of sight.
/// @param sensor  What measured depth: then weights are its inverse variances.
[[nodiscard]] FrameSamples sample_frame(const RgbdFrame& frame,
                                        const core::CameraIntrinsics& intrinsics,
                                        const LiftOptions& options, DepthSensor sensor);

}  // namespace segsim::reconstruction::internal
