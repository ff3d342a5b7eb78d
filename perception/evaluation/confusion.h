#pragma once

/// @file
/// What is taken for what: a confusion matrix of detections, and the errors behind it.

#include <span>
#include <vector>

#include "perception/evaluation/average_precision.h"

namespace segsim::perception {

/// Why a detection or an object is an error.
enum class MissKind : unsigned char {
  kMissed,      ///< An object that nothing found.
  kWrongClass,  ///< A detection on an object of another class.
  kBackground,  ///< A detection where nothing is.
};
[[nodiscard]] const char* to_string(MissKind kind);

struct Miss {
  MissKind kind = MissKind::kMissed;
  int image = 0;
  int truth = -1;      ///< Index into the image's truth; -1 for kBackground.
  int detection = -1;  ///< Index into the image's detections; -1 for kMissed.
};

struct ConfusionMatrix {
  int class_count = 0;
  /// Row = truth, column = detection, row-major, (class_count + 1)^2; the last row is
  /// "nothing there", the last column "not found".
  std::vector<int> counts;
  std::vector<Miss> misses;  ///< By image, then objects, then detections.

  [[nodiscard]] int at(int truth, int detected) const {
    return counts[static_cast<std::size_t>(truth * (class_count + 1) + detected)];
  }
};

/// Pairs detections of at least `score_threshold` with objects whatever their classes, pairs
/// of the same class first and greater IoU before smaller, down to `min_iou`. Ignored objects
/// and crowds, and detections on them that found no object, are left out.
[[nodiscard]] ConfusionMatrix confusion_matrix(std::span<const ImageResult> images,
                                               int class_count, double score_threshold,
                                               double min_iou = 0.5);

}  // namespace segsim::perception
