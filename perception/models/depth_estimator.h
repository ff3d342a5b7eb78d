#pragma once

/// @file
/// Depth of every pixel from colours alone, by a network that states metres (ZoeDepth, the
/// metric Depth Anything V2): one image [1, 3, h, w] -> [1, h, w] or [1, 1, h, w]. The picture
/// is scaled to the input's size, the depth back to the picture's (bilinear).

#include <filesystem>
#include <memory>

#include "core/image.h"

namespace segsim::perception {

class DepthEstimator {
 public:
  DepthEstimator() = default;
  virtual ~DepthEstimator() = default;
  DepthEstimator(const DepthEstimator&) = delete;
  DepthEstimator& operator=(const DepthEstimator&) = delete;

  /// Along the optical axis, as large as the image. @throws core::InputError if the model
  /// answers with another shape or with numbers that are no depths.
  virtual void infer(const core::Image<core::Rgb8>& image, core::Image<float>& depth_m) = 0;
};

/// @param model  A description with task depth (model_description.h).
/// @throws core::InputError for damaged files, another signature or task.
[[nodiscard]] std::unique_ptr<DepthEstimator> load_depth_estimator(
    const std::filesystem::path& model);

}  // namespace segsim::perception
