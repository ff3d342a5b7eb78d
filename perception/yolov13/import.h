#pragma once

/// @file
/// Official YOLOv13 weights -> a weights file of this program (weights_file.h), by name and
/// shape, without loss. checkpoint/tensor_file.h lists the formats that are read; nothing in
/// them is executed.

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "perception/checkpoint/weights_file.h"
#include "perception/checkpoint/yolov13_scale.h"

namespace segsim::perception::yolov13 {

struct ImportOptions {
  std::filesystem::path source{};
  std::optional<Scale> scale{};  ///< Must be the file's, which its first layer tells.
  /// As many as the file has; default: those in the file, else COCO's for 80, else "class 0",
  /// "class 1", ...
  std::vector<std::string> class_names{};
  int input_px = 640;            ///< Side of the square input.
  float score_threshold = 0.25;  ///< Stored with the weights.
};

/// How a file's tensors differ from those wanted, each entry with its shapes.
struct TensorDifferences {
  std::vector<std::string> missing, unexpected, reshaped;

  [[nodiscard]] bool empty() const {
    return missing.empty() && unexpected.empty() && reshaped.empty();
  }
};

struct ImportedWeights {
  DetectorWeights weights;
  TensorDifferences differences;  ///< If not empty, `weights` has no tensors.
};

/// Reads a file and compares it with the network that its first layer and class layer name.
/// Counters of batches (num_batches_tracked) are skipped.
/// @throws core::InputError for a damaged or refused file, one that is no YOLOv13, class names
/// of another number, or constants of the box bins other than 0 ... 15.
[[nodiscard]] ImportedWeights read_official_weights(const ImportOptions& options);

/// read_official_weights() and write_weights().
/// @throws core::InputError also if there are differences: one line with examples of each
/// kind.
/// @param report  Is called with the whole list if there are differences.
DetectorWeights import_weights(
    const ImportOptions& options, const std::filesystem::path& output,
    const std::function<void(const TensorDifferences&)>& report = {});

}  // namespace segsim::perception::yolov13
