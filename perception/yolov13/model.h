#pragma once

/// @file
/// YOLOv13 as a whole, without torch in the interface: build, load, run, count.
/// The detector behind core::Detector is load_detector() (perception/detector/detector.h),
/// which takes weights of this network as well.

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "perception/checkpoint/weights_file.h"
#include "perception/checkpoint/yolov13_scale.h"
#include "perception/yolov13/head_output.h"

namespace segsim::perception::yolov13 {

/// Images of one size, RGB in [0, 1]: [batch, 3, height_px, width_px], multiples of 32.
struct ImageBatch {
  int batch = 0, height_px = 0, width_px = 0;
  std::span<const float> pixels;
};

class Model {
 public:
  /// Random start of training; equal seeds give equal weights on every machine.
  Model(Scale scale, int class_count, std::uint64_t seed = 0);
  /// @throws core::InputError that starts with `place` if the tensors do not fit.
  Model(const DetectorWeights& weights, const std::string& place);
  ~Model();
  Model(Model&&) noexcept;
  Model& operator=(Model&&) noexcept;

  /// In evaluation mode, batch norms not folded.
  [[nodiscard]] HeadOutput forward(const ImageBatch& images) const;
  /// In evaluation mode, with folded batch norms as the detector runs it: equal to forward()
  /// up to rounding. The first call folds a copy.
  [[nodiscard]] HeadOutput forward_folded(const ImageBatch& images);

  /// Parameters and batch-norm statistics, named as in the official state dict, which has in
  /// addition one integer counter (num_batches_tracked) for each batch norm.
  [[nodiscard]] std::vector<NamedTensor> tensors() const;
  /// @throws core::InputError that starts with `place` if the tensors do not fit.
  void import(const std::vector<NamedTensor>& tensors, const std::string& place);

  [[nodiscard]] Scale scale() const { return scale_; }
  [[nodiscard]] int class_count() const { return class_count_; }
  /// With the 16 constants of the DFL, as published.
  [[nodiscard]] std::int64_t parameter_count() const;
  /// Entries of the state dict, counters included.
  [[nodiscard]] int state_entries() const;
  /// 2 x multiply-accumulates of convolutions and linear layers, in 1e9; runs the network.
  [[nodiscard]] double gflops(int input_px) const;

 private:
  struct Network;
  Scale scale_;
  int class_count_;
  std::unique_ptr<Network> network_, folded_;
};

}  // namespace segsim::perception::yolov13
