#pragma once

/// @file
/// What CenterNet is trained on: targets and loss of TTFNet (Liu et al. 2020,
/// "Training-time-friendly network for real-time object detection").
///
/// Around the centre of each box lies a Gaussian with 0.54 of the box's half sides. It is the
/// target of the class's heat, and the cells under it learn the box, where smaller boxes win.

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "perception/data/labeled_box.h"
#include "perception/internal/network/network_output.h"

namespace segsim::perception::centernet {

/// Dense, on the CPU.
struct Targets {
  torch::Tensor heat;  ///< [batch, classes, h, w] in [0, 1]; 1 at centres.
  torch::Tensor
      judged;         ///< [batch, classes, h, w]; 0 inside ignored boxes of the class, else 1.
  torch::Tensor box;  ///< [batch, 4, h, w] corners in pixels of the input.
  torch::Tensor weight;  ///< [batch, h, w] of the box; those of one object sum to ln(area).
};

/// @param truth  For each image; corners in pixels of the input, inside it.
[[nodiscard]] Targets make_targets(const std::vector<std::vector<LabeledBox>>& truth,
                                   std::int64_t class_count, std::int64_t height_cells,
                                   std::int64_t width_cells);

/// Means over the objects of a batch, before the gains.
struct HeatLossParts {
  torch::Tensor classes;  ///< Focal loss of the heat over the number of centres.
  torch::Tensor box;      ///< 1 - CIoU, weighted.
};

/// Complete IoU of corner boxes [n, 4] x [n, 4] -> [n] with TTFNet's conventions, where the
/// last pixel belongs to a box: sides are one pixel longer in areas and overlaps. The aspect
/// counts only above an IoU of 0.5, and its weight has no gradient.
[[nodiscard]] torch::Tensor inclusive_ciou_rows(const torch::Tensor& a,
                                                const torch::Tensor& b);

/// @param maps  Float. @param truth  As in make_targets().
[[nodiscard]] HeatLossParts heat_loss(const HeatMaps& maps,
                                      const std::vector<std::vector<LabeledBox>>& truth);

}  // namespace segsim::perception::centernet
