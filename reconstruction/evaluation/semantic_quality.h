#pragma once

/// @file
/// Mean intersection over union and mean accuracy (class recall) of the classes, in the two
/// conventions that papers mix:
///
///     per frame   IoU of a class = mean over the views whose truth shows it; false positives
///     in
///                 other views are charged to the true class only   (PVLFF, PanopticRecon++)
///     pooled      one confusion matrix of all views                (ScanNet, Panoptic
///     Lifting)

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene_bundle.h"
#include "reconstruction/evaluation/contingency.h"

namespace segsim::reconstruction {

struct SemanticRules {
  bool per_frame = false;
  /// A class that no view shows enters the means as 0.
  bool absent_class_is_zero = false;
  /// Void counts as a class with IoU 0 once it is predicted on a valid pixel.
  bool void_is_a_class = false;

  [[nodiscard]] static SemanticRules pooled() { return {}; }
  [[nodiscard]] static SemanticRules averaged_per_frame() { return {.per_frame = true}; }
  [[nodiscard]] static SemanticRules zju() {
    return {.per_frame = true, .absent_class_is_zero = true};
  }
  [[nodiscard]] static SemanticRules panoptic_lifting() { return {.void_is_a_class = true}; }
};

struct ClassSemantic {
  std::uint16_t class_id = 0;
  double iou = 0.0, accuracy = 0.0;
  bool has_iou = false;       ///< Enters the mean IoU.
  bool has_accuracy = false;  ///< Enters the mean accuracy: the truth shows the class.
};

/// In [0, 1]; 0 without any class.
struct SemanticQuality {
  std::vector<ClassSemantic> classes;  ///< In the order given.
  double mean_iou = 0.0, mean_accuracy = 0.0;
};

/// Valid pixels are those whose true class is evaluated.
/// @param classes  Those evaluated.
[[nodiscard]] SemanticQuality semantic_quality(const ContingencyTable& table,
                                               std::span<const core::SceneClass> classes,
                                               const SemanticRules& rules);

}  // namespace segsim::reconstruction
