#pragma once

#include <torch/torch.h>

#include <vector>

#include "perception/data/labeled_box.h"
#include "perception/internal/loss/assigner.h"
#include "perception/internal/network/network.h"

namespace segsim::perception {

/// Sums over the batch, each divided by max(sum of target scores, 1), before the gains.
struct LossParts {
  torch::Tensor box;      ///< 1 - CIoU
  torch::Tensor classes;  ///< Binary cross entropy
  torch::Tensor bins;     ///< Distribution focal loss
  /// Weighted sum times the batch size.
  [[nodiscard]] torch::Tensor total(int64_t batch) const {
    return (7.5 * box + 0.5 * classes + 1.5 * bins) * static_cast<double>(batch);
  }
};

/// CIoU of corner boxes, row by row, [n, 4] x [n, 4] -> [n]; ciou.h says how. The weight alpha
/// has no gradient.
[[nodiscard]] torch::Tensor ciou_rows(const torch::Tensor& a, const torch::Tensor& b);

/// Cross entropy against the two bins beside each distance, mean over the four sides.
/// @param logits  [n, 4 * kRegBins].  @param distances  [n, 4] in strides, clamped to
/// [0, 14.99].
/// @returns [n]
[[nodiscard]] torch::Tensor bin_loss_rows(const torch::Tensor& logits,
                                          const torch::Tensor& distances);

/// Loss of one batch (assigner.h makes the targets from the present predictions).
/// @param truth  Per image, boxes in pixels of the input square.
[[nodiscard]] LossParts detection_loss(const RawOutput& output, const Anchors& anchors,
                                       const std::vector<std::vector<LabeledBox>>& truth,
                                       const AssignerRule& rule = {});

}  // namespace segsim::perception
