#pragma once

/// @file
/// From squares of bytes to boxes, for a batch: what lies between letterbox (letterbox.h) and
/// suppression (nms.h), on the CPU or a GPU.

#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/device_frames.h"
#include "core/image.h"
#include "core/stages.h"
#include "perception/data/letterbox.h"
#include "perception/detector/internal/inference_network.h"

namespace segsim::perception {

/// All (anchor, class) pairs, or peaks of a heat map, of one image that reach the threshold,
/// in pixels of the square, by ascending anchor or cell and class.
using Candidates = std::vector<core::Detection>;

class Inference {
 public:
  /// @param mixed_precision  float16 where it is safe; only on CUDA.
  Inference(InferenceNetwork network, int input_px, const torch::Device& device,
            bool mixed_precision);

  /// [n, 3, input_px, input_px] in [0, 1] on the device, from n >= 1 squares.
  [[nodiscard]] torch::Tensor upload(std::span<const core::Image<core::Rgb8>> squares);

  /// The same from pictures that lie on the device: scaled (area average when shrinking,
  /// bilinear when growing, rounded to whole levels) onto grey there. Equal to letterbox() up
  /// to one level of 255, and exactly where nothing is scaled.
  /// @param rgb  uint8 [n, height, width, 3].
  [[nodiscard]] torch::Tensor letterbox_on_device(const torch::Tensor& rgb,
                                                  const Letterbox& fit);

  /// For each image of the input. The results are in host memory.
  [[nodiscard]] std::vector<Candidates> candidates(const torch::Tensor& input,
                                                   float score_threshold) const;

 private:
  [[nodiscard]] std::vector<Candidates> decode(const RawOutput& output,
                                               float score_threshold) const;
  [[nodiscard]] std::vector<Candidates> decode(const HeatMaps& maps,
                                               float score_threshold) const;

  /// Matrices [out, in] that scale one axis.
  struct Scaling {
    torch::Tensor x, y;
  };
  const Scaling& scaling_for(const Letterbox& fit);

  InferenceNetwork network_;
  int input_px_;
  torch::Device device_;
  bool mixed_precision_;
  Anchors anchors_;                                  ///< On the device.
  Anchors host_anchors_;                             ///< On the CPU.
  torch::Tensor staging_;                            ///< Page-locked bytes; only on CUDA.
  std::map<std::pair<int, int>, Scaling> scalings_;  ///< By the picture's size.
};

/// The same candidates by tensor operations on the device of `output`, of which only the hits
/// travel to the host.
[[nodiscard]] std::vector<Candidates> candidates_on_device(const RawOutput& output,
                                                           const Anchors& anchors,
                                                           float score_threshold);

/// By loops on the CPU; `output` and `anchors` lie there.
[[nodiscard]] std::vector<Candidates> candidates_on_host(const RawOutput& output,
                                                         const Anchors& anchors,
                                                         float score_threshold);

}  // namespace segsim::perception
