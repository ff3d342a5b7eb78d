#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/image.h"

namespace segsim::reconstruction::internal {

/// Brightness, 8 bit.
[[nodiscard]] inline cv::Mat grey_image(const core::Image<core::Rgb8>& rgb) {
  static_assert(sizeof(core::Rgb8) == 3);
  // OpenCV reads through a pointer that is not const.
  const cv::Mat view(rgb.height_px(), rgb.width_px(), CV_8UC3,
                     const_cast<core::Rgb8*>(rgb.data()));
  cv::Mat grey;
  cv::cvtColor(view, grey, cv::COLOR_RGB2GRAY);
  return grey;
}

}  // namespace segsim::reconstruction::internal
