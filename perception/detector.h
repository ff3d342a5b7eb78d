#pragma once

/// @file
/// The learned detector: a small anchor-free network (internal/network.h) or a YOLOv13
/// (yolov13/model.h), as the weights say, behind core::Detector.
///
///     image -> letterbox (letterbox.h) -> network -> boxes per anchor -> NMS (nms.h)
///
/// Equal weights, image and thread count give equal detections.

#include <filesystem>
#include <memory>
#include <optional>

#include "core/stages.h"

namespace segsim::perception {

struct DetectorOptions {
  std::optional<float>
      score_threshold;       ///< [0, 1]; the one stored with the weights if not set.
  float nms_iou = 0.65F;     ///< Per class; above it the lower score is dropped.
  int max_detections = 100;  ///< Per image.
};

/// Loads a weights file (weights_file.h). The detector reads only `rgb` of an observation.
/// One object serves one thread at a time.
/// @throws core::InputError if the file is damaged or does not fit the network.
[[nodiscard]] std::unique_ptr<core::Detector> load_detector(
    const std::filesystem::path& weights, const DetectorOptions& options = {});

/// Threads inside one forward or training pass; 1 until this is called, which is the best for
/// images up to 320 px. Holds for all threads of the process, and for OpenCV as well.
/// Floating-point sums, and so scores in the last digits, depend on it. train() sets its own
/// count and restores this one.
void set_threads(int count);
[[nodiscard]] int threads();

}  // namespace segsim::perception
