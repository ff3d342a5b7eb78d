#pragma once

/// @file
/// MobileNetV3-CenterNet: a light backbone, a pyramid that leads back to stride 4, and for
/// each cell of that map a logit for each class (high at the centre of an object) and the
/// distances to the four sides of its box (Zhou et al. 2019, "Objects as points"; Liu et al.
/// 2020, "Training-time-friendly network for real-time object detection").
///
///     stem 16 - blocks 0..2 - 3..5 - 6..11 - 12..14 - widen 480
///     stride 2           4      8     16       32
///                  |  c2 72  |  c3 96  |  c4 88  |
///                  merge2 <- merge3 <- merge4 <--+
///                     |
///              gate, class_head, box_head
///
/// c2 and c3 are the expanded maps inside blocks 3 and 5. docs/centernet.md has the table.

#include <torch/torch.h>

#include <cstdint>
#include <vector>

#include "perception/internal/centernet/layers.h"
#include "perception/internal/network/network_output.h"

namespace segsim::perception::centernet {

inline constexpr int kBlockCount = 15;  ///< Of the backbone.
inline constexpr int kStride_px = 4;    ///< Pixels of the input for each cell of the output.

class NetworkImpl : public torch::nn::Module {
 public:
  explicit NetworkImpl(int class_count);
  /// @param x  [batch, 3, h, w], RGB in [0, 1]; sides are multiples of 32.
  /// @returns maps of h / 4 x w / 4 cells.
  HeatMaps forward(const torch::Tensor& x);
  /// Eval mode with the weights as oneDNN wants them; training is over.
  void prepare_for_inference();
  /// Random start (uniform, variance 2 / fan-in), keyed by seed and parameter name; the heads
  /// begin near 0, and every class with a score of 0.1.
  void initialize(std::uint64_t seed);

 private:
  Conv stem_{nullptr}, widen_{nullptr};
  std::vector<Block> blocks_;
  Merge merge4_{nullptr}, merge3_{nullptr}, merge2_{nullptr};
  Squeeze gate_{nullptr};
  Separable class_head_{nullptr}, box_head_{nullptr};
};
TORCH_MODULE(Network);

}  // namespace segsim::perception::centernet
