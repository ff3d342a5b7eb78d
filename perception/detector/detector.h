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
#include <span>
#include <vector>

#include "core/device_frames.h"
#include "core/stages.h"
#include "perception/data/compute_device.h"

namespace segsim::perception {

struct DetectorOptions {
  std::optional<float>
      score_threshold;       ///< [0, 1]; the one stored with the weights if not set.
  float nms_iou = 0.65F;     ///< Per class; above it the lower score is dropped.
  int max_detections = 100;  ///< Per image.
  ComputeDevice device = ComputeDevice::kCpu;
  bool mixed_precision = false;  ///< float16 where it is safe; CUDA only.
};

/// Detects for several robots in one forward pass.
class BatchDetector : public core::Detector {
 public:
  /// @param images  Of any sizes, none empty; may be no image at all.
  /// @returns for each image what detect() finds in it, up to the last digits: sums of a batch
  ///     may have another order.
  [[nodiscard]] virtual std::vector<std::vector<core::Detection>> detect_batch(
      std::span<const core::Image<core::Rgb8>* const> images) = 0;

  /// The same for the images of a renderer where they lie, without a copy: on a GPU the
  /// network runs in the renderer's stream, so nobody waits between drawing and detecting.
  /// Boxes are in pixels of the images. Where these are scaled, levels may differ by one from
  /// those of detect().
  /// @param frames  With `rgb`; in the host's memory for a detector on the CPU, on a GPU for
  ///     one on CUDA.
  /// @throws core::InputError if they lie elsewhere.
  [[nodiscard]] virtual std::vector<std::vector<core::Detection>> detect_frames(
      const core::DeviceFrames& frames) = 0;
};

/// Loads a weights file (weights_file.h). The detector reads only `rgb` of an observation.
/// One object serves one thread at a time.
/// @throws core::InputError if the file is damaged or does not fit the network, or for CUDA or
///     mixed precision where there is none.
[[nodiscard]] std::unique_ptr<BatchDetector> load_detector(
    const std::filesystem::path& weights, const DetectorOptions& options = {});

/// Threads inside one forward or training pass; 1 until this is called, which is the best for
/// images up to 320 px. Holds for all threads of the process but those with a
/// ThreadCountScope, and for OpenCV as well. Floating-point sums, and so scores in the last
/// digits, depend on it.
void set_threads(int count);
/// That of the calling thread.
[[nodiscard]] int threads();

/// A count of the calling thread's own while it lives, so that several threads of a process
/// can train or detect side by side, each with so many threads of OpenMP below it. Those at
/// work at the same time shall have equal counts: OpenBLAS keeps one for the process, and
/// whichever thread sums by another count than its own gets other last digits.
class ThreadCountScope {
 public:
  explicit ThreadCountScope(int count);
  ~ThreadCountScope();
  ThreadCountScope(const ThreadCountScope&) = delete;
  ThreadCountScope& operator=(const ThreadCountScope&) = delete;

 private:
  int before_;
};

}  // namespace segsim::perception
