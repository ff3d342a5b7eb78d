#pragma once

/// @file
/// Average precision of a detector in this project's types, and its operating point. The rules
/// are those of coco_evaluation.h: area "all", 100 detections per image and class.

#include <span>
#include <vector>

#include "core/stages.h"
#include "perception/data/labeled_box.h"
#include "perception/evaluation/coco_evaluation.h"

namespace segsim::perception {

struct ImageResult {
  std::vector<LabeledBox> truth;
  std::vector<core::Detection> detections;  ///< Any order; ties of score count in this order.
};

/// What a score threshold yields at IoU 0.5.
struct OperatingPoint {
  float score_threshold = 0.0F;
  int true_positives = 0, false_positives = 0, missed = 0;
  [[nodiscard]] double precision() const;  ///< 0 without detections.
  [[nodiscard]] double recall() const;     ///< 0 without objects.
  [[nodiscard]] double f1() const;         ///< 0 without true positives.
};

struct ClassPrecision {
  int objects = 0;   ///< Scored ground-truth boxes.
  double ap = -1.0;  ///< Mean over the ten IoU thresholds; -1 without objects.
  double ap50 = -1.0;
  OperatingPoint operating;
};

struct PrecisionReport {
  double ap = -1.0, ap50 = -1.0;  ///< Mean over classes with objects; -1 if there are none.
  std::vector<ClassPrecision> classes;
  OperatingPoint operating;  ///< All classes together.
};

[[nodiscard]] RegionPx region_of(const core::BoxPx& box);
[[nodiscard]] TruthRegion truth_region(const LabeledBox& box);
/// The same images for coco_evaluation.h, in the same order.
[[nodiscard]] std::vector<EvaluationImage> evaluation_images(
    std::span<const ImageResult> images);

/// @param class_count  Classes are 0 ... class_count - 1.
/// @param score_threshold  Of the operating points; AP always uses every detection.
[[nodiscard]] PrecisionReport average_precision(std::span<const ImageResult> images,
                                                int class_count, float score_threshold);

/// What each threshold yields at IoU 0.5, all classes together, from the highest on. Each lies
/// halfway to the next lower score, so that rounding does not decide.
[[nodiscard]] std::vector<OperatingPoint> operating_points(std::span<const ImageResult> images,
                                                           int class_count);

/// The one with the greatest F1; among equals the highest threshold. Without any true
/// positive: a threshold of 0.5.
[[nodiscard]] OperatingPoint best_f1(std::span<const OperatingPoint> points);

/// The one that finds most among those of at least this precision; among equals the highest
/// threshold. If there is none: best_f1().
[[nodiscard]] OperatingPoint most_recall(std::span<const OperatingPoint> points,
                                         double least_precision);

}  // namespace segsim::perception
