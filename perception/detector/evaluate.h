#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "perception/data/compute_device.h"
#include "perception/data/dataset.h"
#include "perception/evaluation/average_precision.h"

namespace segsim::perception {

struct EvaluateOptions {
  std::optional<float> score_threshold;  ///< Of the operating point; default: the stored one.
  std::map<std::string, std::string>
      rename;  ///< Data set's class -> detector's; "" leaves it out.
  ComputeDevice device = ComputeDevice::kCpu;
};

struct EvaluationReport {
  std::vector<std::string> class_names;  ///< The detector's.
  int images = 0;
  PrecisionReport precision;
  double mean_detect_ms = 0.0;  ///< Wall time of one image, without reading the file.
};

/// Runs the weights over a data set. Classes are matched by name.
/// @throws core::InputError for damaged files or a data set class that the detector does not
/// know.
[[nodiscard]] EvaluationReport evaluate(const std::filesystem::path& weights,
                                        const std::filesystem::path& coco_json,
                                        const EvaluateOptions& options = {});

/// Detections of every image of a data set, down to a score of 0.001, with the truth beside
/// them.
[[nodiscard]] std::vector<ImageResult> detect_all(const std::filesystem::path& weights,
                                                  const CocoDataset& dataset,
                                                  ComputeDevice device = ComputeDevice::kCpu);

/// Renames and renumbers the classes of `dataset` so that they are `class_names`; boxes of
/// classes renamed to "" are dropped.
/// @throws core::InputError if a class (after renaming) that has boxes is not in
/// `class_names`.
void match_classes(CocoDataset& dataset, const std::vector<std::string>& class_names,
                   const std::map<std::string, std::string>& rename);

}  // namespace segsim::perception
