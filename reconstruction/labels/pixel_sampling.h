#pragma once

/// @file
/// Which pixels of an image a step is trained on (PanopticRecon++: half of them on stuff, a
/// fifth on instances, the rest anywhere), so that small objects are not lost among walls.

#include <cstdint>
#include <span>
#include <vector>

#include "core/frame_masks.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "reconstruction/labels/panoptic_config.h"

namespace segsim::reconstruction {

struct PixelSample {
  std::vector<std::int32_t> pixels;  ///< y * width + x, ascending; a pixel may come twice.
  /// [pixels], mean 1: 1 / how often a pixel like this is drawn. A mean with these weights is
  /// one over the image, whatever was drawn more often. Without them masks that are drawn
  /// often grow over their borders.
  std::vector<float> importance;
};

/// Fewer than config.pixels if the image has fewer to offer, none if no pixel has a depth.
/// @param depth_m  Empty, or of the masks' size: pixels that are not farther than min_depth_m
///     are never drawn, nor are those of unknown depth.
[[nodiscard]] PixelSample sample_pixels(const core::FrameMasks& masks,
                                        const core::Image<float>& depth_m,
                                        std::span<const core::SceneClass> classes,
                                        const PixelSamplingConfig& config,
                                        core::RandomStream& random);

}  // namespace segsim::reconstruction
