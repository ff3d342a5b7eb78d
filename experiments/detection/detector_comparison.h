#pragma once

/// @file
/// Two detectors, 'before' and 'after', on the same images: how much better, for which
/// classes, sizes and distances, and how sure that is.
///
/// Intervals are percentile bootstrap intervals (Efron 1979): images are drawn with
/// replacement, the same draw for both detectors, and every number is computed anew from it.
/// Images of one place resemble each other, so the intervals hold for views of *these* places,
/// not for others.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "experiments/results/statistics.h"
#include "perception/data/dataset.h"
#include "perception/evaluation/coco_evaluation.h"
#include "perception/evaluation/confusion.h"

namespace segsim::experiments::detection {

/// A number with its bootstrap interval; -1 without objects.
struct Estimate {
  double value = -1.0;
  results::Interval interval{-1.0, -1.0};
};

enum class Score : unsigned char { kAp, kAp50, kAr1, kAr10, kAr100 };
inline constexpr int kScores = 5;
[[nodiscard]] const char* to_string(Score score);

/// Some of the objects: a class, a size, a range of distance.
struct ComparisonRow {
  std::string group;  ///< "all", "class", "size", "distance".
  std::string name;   ///< "chair", "small", "3 to 5 m"; empty for all.
  int objects = 0;
  std::array<Estimate, kScores> before, after, difference;  ///< after - before, paired.
};

/// Precision at the 101 recall points, IoU 0.5.
struct PrecisionCurve {
  std::string name;  ///< Class, or "mean" over those with objects.
  std::array<double, perception::kRecallPoints> before{}, after{};
};

struct DetectorErrors {
  perception::ConfusionMatrix confusion;
  double score_threshold = 0.0, precision = 0.0, recall = 0.0;
};

/// One set of images.
struct SetComparison {
  std::string name;
  std::filesystem::path json;
  perception::CocoDataset dataset;  ///< Ascending by image id.
  std::vector<perception::ImageResult> before_results, after_results;
  std::vector<ComparisonRow> rows;
  std::vector<PrecisionCurve> curves;  ///< The mean first.
  DetectorErrors before, after;
};

struct ComparisonOptions {
  std::filesystem::path before{}, after{};            ///< Weights.
  std::vector<double> distances_m = {1.5, 3.0, 5.0};  ///< Borders, ascending.
  int rounds = 1000;
  double confidence = 0.95;
  std::uint64_t seed = 1;
};

/// Runs both detectors on a data set and compares them.
/// @throws core::InputError: broken files, detectors with different classes, a data set
/// without images or with a class that the detectors do not know.
[[nodiscard]] SetComparison compare_on_set(const ComparisonOptions& options,
                                           const std::string& name,
                                           const std::filesystem::path& coco_json);

/// The comparison itself, from detections that are there already: fills `rows` and `curves`.
void compare_results(const ComparisonOptions& options, SetComparison& set);

}  // namespace segsim::experiments::detection
