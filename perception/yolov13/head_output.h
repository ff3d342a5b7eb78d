#pragma once

/// @file
/// What the network says before decoding, as plain numbers, and the two things made of it:
/// predictions and the training loss.

#include <cstdint>
#include <vector>

#include "perception/data/labeled_box.h"

namespace segsim::perception::yolov13 {

/// Anchors: strides 8, 16, 32 one after the other, each level row by row, the centre of a cell
/// at (i + 0.5, j + 0.5) strides.
struct HeadOutput {
  int batch = 0, class_count = 0;
  int height_px = 0, width_px = 0;  ///< Of the input, multiples of 32.
  std::vector<float> box;      ///< [batch, anchors, 4 * 16] logits: left, top, right, bottom.
  std::vector<float> classes;  ///< [batch, anchors, class_count] logits.

  [[nodiscard]] std::int64_t anchors() const;
};

/// Boxes and scores of all anchors, in the layout of the reference:
/// [batch, 4 + class_count, anchors], rows centre x, centre y, width, height in pixels of the
/// input, then one sigmoid score per class.
[[nodiscard]] std::vector<float> decode(const HeadOutput& output);

/// Averages as published: each part a sum over the batch divided by max(sum of target scores,
/// 1), before the gains.
struct LossValues {
  double box = 0.0;      ///< 1 - CIoU; gain 7.5.
  double classes = 0.0;  ///< Binary cross entropy; gain 0.5.
  double bins = 0.0;     ///< Distribution focal loss; gain 1.5.
  double total = 0.0;    ///< Sum with gains, times the batch size.
};

/// Task-aligned assignment and loss (internal/detection_loss.h, kYoloRule).
/// @param truth  Per image, boxes in pixels of the input.
[[nodiscard]] LossValues loss(const HeadOutput& output,
                              const std::vector<std::vector<LabeledBox>>& truth);

}  // namespace segsim::perception::yolov13
