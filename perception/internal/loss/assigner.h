#pragma once

/// @file
/// Task-aligned assignment (Feng et al. 2021, "TOOD"): which anchors shall find which object,
/// and how well they are asked to score. An anchor is a candidate for a box if its centre lies
/// in it; it is ranked by t = score^0.5 * CIoU^6 of its present prediction; the ten best of
/// each box are taken. An anchor taken by several boxes goes to that of the highest CIoU. Its
/// target score is t / (max t of the box) * (max CIoU of the box).
///
/// Anchors inside an ignored box are not told that its class is absent (weight 0): the object
/// is there, only too hidden to be labelled.

#include <cstdint>
#include <span>
#include <vector>

#include "perception/data/labeled_box.h"

namespace segsim::perception {

inline constexpr int kCandidatesPerBox = 10;

/// Two points that the paper leaves open.
struct AssignerRule {
  /// Added to the max t of a box before the division.
  double alignment_eps = 0.0;
  /// A contested anchor goes to the highest CIoU of all boxes around its centre, also of those
  /// that did not take it.
  bool all_boxes_contest = false;
};
/// As the trainers of the YOLO family decide them.
inline constexpr AssignerRule kYoloRule{1e-9, true};

/// One image. Boxes and centres in pixels of the network's input.
struct AssignerInput {
  int class_count = 0;
  std::span<const float> centre_px;  ///< [anchors * 2]
  std::span<const float> scores;     ///< [anchors * class_count], after the sigmoid
  std::span<const float> boxes;      ///< [anchors * 4], x0 y0 x1 y1
  std::span<const LabeledBox> truth;
};

struct Assignment {
  std::vector<int> box_of_anchor;          ///< [anchors] index into truth, -1 = background
  std::vector<float> target_score;         ///< [anchors], for the class of its box
  std::vector<std::uint8_t> class_weight;  ///< [anchors * class_count], 0 = not judged
};

[[nodiscard]] Assignment assign_anchors(const AssignerInput& input,
                                        const AssignerRule& rule = {});

}  // namespace segsim::perception
