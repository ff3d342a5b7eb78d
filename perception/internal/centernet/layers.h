#pragma once

/// @file
/// Layers of MobileNetV3-CenterNet. Batch norms were merged into the published weights, so
/// each convolution has a bias instead.
///
/// Padding is TensorFlow's "SAME": at stride 2 and even sides one row and column less at the
/// top and the left than at the bottom and the right.

#include <torch/torch.h>

#include "perception/internal/network/onednn.h"

namespace segsim::perception::centernet {

/// Convolution, bias, activation.
class ConvImpl : public torch::nn::Module {
 public:
  /// @param kernel  Odd. @param groups  1, or `in` = `out` for a depthwise one.
  ConvImpl(int in, int out, int kernel, Activation activation = Activation::kNone,
           int stride = 1, int groups = 1, bool biased = true);
  torch::Tensor forward(const torch::Tensor& x);
  /// base + forward(x), in the memory of `base` where that is possible; without an activation.
  torch::Tensor forward_onto(const torch::Tensor& base, const torch::Tensor& x);
  /// Prepares the weights for oneDNN: for inference only, cannot be undone.
  void fold();

 private:
  ConvolutionForm form_;
  torch::Tensor weight_, bias_;
  FoldedConvolution folded_;
};
TORCH_MODULE(Conv);

/// Depthwise convolution without bias, then 1 x 1.
class SeparableImpl : public torch::nn::Module {
 public:
  /// @param last  Name of the 1 x 1 convolution.
  SeparableImpl(int in, int out, int kernel, const char* last = "pointwise");
  torch::Tensor forward(const torch::Tensor& x);
  torch::Tensor forward_onto(const torch::Tensor& base, const torch::Tensor& x);

 private:
  Conv depthwise_{nullptr}, pointwise_{nullptr};
};
TORCH_MODULE(Separable);

/// Weights channels by a gate in [0, 1] that two layers make of their means (Hu et al. 2018,
/// "Squeeze-and-excitation networks").
class SqueezeImpl : public torch::nn::Module {
 public:
  enum class Gate { kHardSigmoid, kSigmoid };
  SqueezeImpl(int channels, int hidden, Gate gate);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  Gate gate_;
  Conv reduce_{nullptr}, expand_{nullptr};
};
TORCH_MODULE(Squeeze);

/// Of the backbone (Howard et al. 2019, "Searching for MobileNetV3").
struct BlockForm {
  int kernel, stride;
  int expanded;  ///< Channels in between; 0: no expansion.
  int out;
  int squeezed;  ///< Hidden channels of the gate; 0: none.
  Activation activation;
};

/// 1 x 1 up, depthwise, gate, 1 x 1 down, and the input added where shapes agree.
class BlockImpl : public torch::nn::Module {
 public:
  BlockImpl(int in, const BlockForm& form);
  /// The first half: what `finish` goes on with.
  torch::Tensor expand(const torch::Tensor& x);
  torch::Tensor finish(const torch::Tensor& x, const torch::Tensor& expanded);

 private:
  bool residual_;
  Conv expand_{nullptr}, depthwise_{nullptr}, project_{nullptr};
  Squeeze squeeze_{nullptr};
};
TORCH_MODULE(Block);

/// Joins a level of the backbone with the coarser map above it:
/// relu(concat(skip, twice as large(top))), each with `out` channels.
class MergeImpl : public torch::nn::Module {
 public:
  /// @param lateral  Channels between the two halves of the skip.
  MergeImpl(int level, int lateral, int top, int out);
  /// @param level  [batch, level, 2 h, 2 w]. @param top  [batch, top, h, w].
  torch::Tensor forward(const torch::Tensor& level, const torch::Tensor& top);

 private:
  Conv lateral_{nullptr};
  Separable skip_{nullptr}, up3_{nullptr}, up5_{nullptr};
};
TORCH_MODULE(Merge);

/// Twice the sides: pixel 2 i is pixel i, pixel 2 i + 1 the mean of i and i + 1 (the border
/// repeats), as TensorFlow 1 scales by default.
[[nodiscard]] torch::Tensor double_sides(const torch::Tensor& x);

}  // namespace segsim::perception::centernet
