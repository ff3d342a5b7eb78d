#pragma once

#include <ATen/ATen.h>

#include <cstdint>

namespace segsim::perception {

/// Mask R-CNN's RoIAlign, for ONNX and for TorchScript's torchvision::roi_align.
struct RoiAlignRule {
  std::int64_t height = 1, width = 1;  ///< Cells of the result, >= 1.
  std::int64_t sampling_ratio = 0;     ///< Samples per cell and axis; <= 0: as many as pixels.
  double spatial_scale = 1.0;          ///< Box units -> pixels of `input`.
  bool half_pixel = true;              ///< Pixel centres at +0.5 (torchvision: aligned).
  bool take_max = false;               ///< Of the samples, instead of their mean.
};

/// @param input  [images, channels, h, w] float. @param boxes  [boxes, 4] x0, y0, x1, y1
/// float.
/// @param images  [boxes] int64, into the first axis of `input`; must be in range.
/// @returns [boxes, channels, rule.height, rule.width]
[[nodiscard]] at::Tensor roi_align(const at::Tensor& input, const at::Tensor& boxes,
                                   const at::Tensor& images, const RoiAlignRule& rule);

/// Greedy suppression in descending score (ties: lower index first): indices of the kept
/// boxes.
/// @param boxes  [boxes, 4] two opposite corners, in either order.
[[nodiscard]] std::vector<std::int64_t> greedy_suppression(
    const float* boxes, const float* scores, std::vector<std::int64_t> candidates,
    double max_iou, std::int64_t max_count);

}  // namespace segsim::perception
