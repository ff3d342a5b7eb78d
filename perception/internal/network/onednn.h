#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>

namespace segsim::perception {

/// Whether a layer may call oneDNN itself: on the CPU, in single precision, without gradients.
[[nodiscard]] bool runs_on_onednn(const torch::Tensor& x);

enum class Activation { kNone, kSilu, kRelu, kHardSwish };

/// kHardSwish is this times the published x relu6(x + 3) / 6: weights of MobileNetV3 were
/// converted with a float16 in the place of 1/6.
inline constexpr double kHardSwishGain = 6.0 * 0.1666259765625;

/// The function itself; hard_sigmoid() is its gate relu6(x + 3) / 6, with the same gain.
[[nodiscard]] torch::Tensor activate(const torch::Tensor& x, Activation activation);
[[nodiscard]] torch::Tensor hard_sigmoid(const torch::Tensor& x);

/// How a convolution of kernel k moves and what follows it.
struct ConvolutionForm {
  std::int64_t stride = 1, groups = 1;
  Activation activation = Activation::kNone;
  /// Rows and columns of padding at the top and the left are k / 2 less this, those at the
  /// bottom and the right k / 2.
  std::int64_t less_before = 0;
};

/// A convolution and its activation, by oneDNN where runs_on_onednn().
///
/// On one thread libtorch gives 1 x 1 convolutions to the BLAS library. Where that does not
/// know the processor (OpenBLAS 0.3.21 takes its SSE3 kernels on Emerald Rapids) it took
/// nearly half of a frame of YOLOv13; oneDNN has its own code for all.
[[nodiscard]] torch::Tensor convolve(const torch::Tensor& x, const torch::Tensor& weight,
                                     const torch::Tensor& bias,
                                     const ConvolutionForm& form = {});

/// A convolution whose weights do not change any more, with its activation.
///
/// Where runs_on_onednn(): weights are reordered once, the activation is computed while the
/// result is in registers, and maps have their channels innermost (NHWC), so nothing is
/// reordered in between. Measured on one core with SiLU, this takes half the time of
/// convolve() and silu(), a quarter where maps are large and have few channels.
class FoldedConvolution {
 public:
  FoldedConvolution();  ///< None; empty() until one is assigned.
  /// @param bias  May be undefined.
  FoldedConvolution(const torch::Tensor& weight, const torch::Tensor& bias,
                    const ConvolutionForm& form);
  ~FoldedConvolution();
  FoldedConvolution(FoldedConvolution&&) noexcept;
  FoldedConvolution& operator=(FoldedConvolution&&) noexcept;

  [[nodiscard]] bool empty() const { return !weight_.defined(); }
  /// Multiply-accumulates for one number of the result.
  [[nodiscard]] std::int64_t macs_per_value() const { return weight_[0].numel(); }
  /// One thread at a time.
  [[nodiscard]] torch::Tensor run(const torch::Tensor& x);
  /// base + run(x), in the memory of `base` where that is possible.
  [[nodiscard]] torch::Tensor run_onto(const torch::Tensor& base, const torch::Tensor& x);

 private:
  struct Prepared;
  torch::Tensor run_directly(const torch::Tensor& x, const torch::Tensor& base);

  torch::Tensor weight_, bias_;
  ConvolutionForm form_;
  std::unique_ptr<Prepared> prepared_;  ///< For each size of input that was met.
};

}  // namespace segsim::perception
