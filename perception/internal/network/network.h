#pragma once

/// @file
/// The network: a dense CSP backbone, a two-way feature pyramid (PAN) and a decoupled head per
/// stride, without anchors. Dense 3 x 3 convolutions because they run near the cores' peak;
/// depthwise ones do not.
///
///     stride   2    4    8    16   32
///     channels 16 - 32 - 64 - 128 - 192    (times `width`, rounded up to a multiple of 8)
///                        |     |     |
///                        64   128   128    pyramid, up and down
///                        |     |     |
///                 box: 4 x 16 logits, class: one logit per class
///
/// Box sides are distances from the anchor in strides, each the expectation of a softmax over
/// 16 bins (Li et al. 2020, "Generalized focal loss").

#include <torch/torch.h>

#include <string>
#include <utility>
#include <vector>

#include "perception/checkpoint/weights_file.h"
#include "perception/internal/network/onednn.h"

namespace segsim::perception {

inline constexpr int kRegBins = 16;
inline constexpr int kStrides[] = {8, 16, 32};
inline constexpr double kNormMomentum = 0.03;  ///< Of batch norms, as YOLO models have it.

/// Convolution without bias, batch norm, SiLU.
class ConvBlockImpl : public torch::nn::Module {
 public:
  ConvBlockImpl(int in, int out, int kernel, int stride = 1);
  torch::Tensor forward(const torch::Tensor& x);
  /// Merges the batch norm into the convolution: for inference only, cannot be undone.
  void fold();

 private:
  torch::nn::Conv2d conv_{nullptr};
  torch::nn::BatchNorm2d norm_{nullptr};
  FoldedConvolution folded_;
};
TORCH_MODULE(ConvBlock);

/// Splits into halves, passes one through two 3 x 3 convolutions, concatenates all, mixes.
class CspBlockImpl : public torch::nn::Module {
 public:
  CspBlockImpl(int in, int out, bool shortcut);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  bool shortcut_;
  ConvBlock split_{nullptr}, first_{nullptr}, second_{nullptr}, mix_{nullptr};
};
TORCH_MODULE(CspBlock);

/// Two 3 x 3 blocks and a 1 x 1 convolution with bias.
class HeadBranchImpl : public torch::nn::Module {
 public:
  HeadBranchImpl(int in, int hidden, int out);
  torch::Tensor forward(const torch::Tensor& x);
  /// Prepares the last convolution: for inference only, cannot be undone.
  void fold();

 private:
  ConvBlock first_{nullptr}, second_{nullptr};
  torch::nn::Conv2d last_{nullptr};
  FoldedConvolution folded_;
};
TORCH_MODULE(HeadBranch);

/// Logits of all anchors, strides 8, 16, 32 one after the other, each row by row.
struct RawOutput {
  torch::Tensor box;      ///< [batch, anchors, 4 * kRegBins]: left, top, right, bottom.
  torch::Tensor classes;  ///< [batch, anchors, classes]
};

class TinyDetectorImpl : public torch::nn::Module {
 public:
  TinyDetectorImpl(double width, int class_count, int input_px);
  /// @param x  [batch, 3, h, w], RGB in [0, 1]; sides are multiples of 32.
  RawOutput forward(const torch::Tensor& x);
  /// Eval mode with batch norms folded into the convolutions.
  void prepare_for_inference();
  /// Random start (uniform, variance 1 / (3 fan-in)), keyed by seed and parameter name.
  void initialize(std::uint64_t seed);

 private:
  ConvBlock down1_{nullptr}, down2_{nullptr}, down3_{nullptr}, down4_{nullptr},
      down5_{nullptr};
  CspBlock stage2_{nullptr}, stage3_{nullptr}, stage4_{nullptr}, stage5_{nullptr};
  CspBlock up4_{nullptr}, up3_{nullptr}, pan4_{nullptr}, pan5_{nullptr};
  ConvBlock pan_down3_{nullptr}, pan_down4_{nullptr};
  std::vector<HeadBranch> box_, class_;
  int class_count_, input_px_;
};
TORCH_MODULE(TinyDetector);

/// [batch, channels, h, w] -> [batch, h * w, channels]
[[nodiscard]] torch::Tensor rows_of_anchors(const torch::Tensor& map);

/// Nearest neighbour, twice the sides.
[[nodiscard]] torch::Tensor upsample2(const torch::Tensor& x);

/// Weight and bias of the convolution that does the work of both: for inference only.
[[nodiscard]] std::pair<torch::Tensor, torch::Tensor> fold_norm(
    const torch::Tensor& weight, const torch::nn::BatchNorm2d& norm);

/// Uniform in [-bound, bound), keyed by seed and name.
void fill_uniform(const torch::Tensor& value, double bound, std::uint64_t seed,
                  const std::string& name);

/// Anchor centres [anchors, 2] in pixels and strides [anchors, 1], in RawOutput's order.
struct Anchors {
  torch::Tensor centre_px, stride_px;
};
[[nodiscard]] Anchors make_anchors(int height_px, int width_px,
                                   const torch::TensorOptions& options);
/// Of a square.
[[nodiscard]] Anchors make_anchors(int input_px, const torch::TensorOptions& options);

/// Corners (x0, y0, x1, y1) in pixels. @param box_logits  [..., anchors, 4 * kRegBins].
[[nodiscard]] torch::Tensor decode_boxes(const torch::Tensor& box_logits,
                                         const Anchors& anchors);

/// Parameters and batch-norm statistics by name, in a fixed order.
[[nodiscard]] std::vector<NamedTensor> export_tensors(const torch::nn::Module& module);
/// Copies tensors that must agree in names and shapes.
/// @throws core::InputError that starts with `place` and tells the difference in one line.
void import_tensors(torch::nn::Module& module, const std::vector<NamedTensor>& tensors,
                    const std::string& place);

}  // namespace segsim::perception
