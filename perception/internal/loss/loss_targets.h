#pragma once

#include <torch/types.h>

#include <vector>

#include "perception/data/labeled_box.h"
#include "perception/internal/loss/assigner.h"
#include "perception/internal/network/network.h"

namespace segsim::perception {

/// What the loss asks of a batch: dense for classes, one row per positive anchor for boxes, in
/// the order of images and anchors. On the device of the predictions.
struct LossTargets {
  torch::Tensor score, class_weight;  ///< [batch, anchors, classes]
  torch::Tensor row;                  ///< [positives], index into batch * anchors
  torch::Tensor anchor;               ///< [positives], index into anchors
  torch::Tensor box;                  ///< [positives, 4] pixels
  torch::Tensor weight;               ///< [positives] target score
  double score_sum = 0.0;
};

/// By assign_anchors(), image after image on the CPU; all tensors lie there.
/// @param scores  [batch, anchors, classes], after the sigmoid. @param boxes  [batch, anchors,
/// 4] corners in pixels. @param truth  Per image, boxes in pixels.
[[nodiscard]] LossTargets targets_on_host(const torch::Tensor& scores,
                                          const torch::Tensor& boxes, const Anchors& anchors,
                                          const std::vector<std::vector<LabeledBox>>& truth,
                                          const AssignerRule& rule);

/// The same targets by tensor operations where the predictions lie: only the labelled boxes
/// travel there, and a handful of counts back. In double precision like assign_anchors(), so
/// that both choose the same anchors.
[[nodiscard]] LossTargets targets_on_device(const torch::Tensor& scores,
                                            const torch::Tensor& boxes, const Anchors& anchors,
                                            const std::vector<std::vector<LabeledBox>>& truth,
                                            const AssignerRule& rule);

}  // namespace segsim::perception
