#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>

namespace segsim::perception {

/// Whether a layer may call oneDNN itself: on the CPU, in single precision, without gradients.
[[nodiscard]] bool runs_on_onednn(const torch::Tensor& x);

/// A convolution with padding k / 2, by oneDNN where runs_on_onednn().
///
/// On one thread libtorch gives 1 x 1 convolutions to the BLAS library. Where that does not
/// know the processor (OpenBLAS 0.3.21 takes its SSE3 kernels on Emerald Rapids) it took
/// nearly half of a frame of YOLOv13; oneDNN has its own code for all.
[[nodiscard]] torch::Tensor convolve(const torch::Tensor& x, const torch::Tensor& weight,
                                     const torch::Tensor& bias, std::int64_t stride,
                                     std::int64_t groups);

/// A convolution whose weights do not change any more, with SiLU behind it if `activate`.
///
/// Where runs_on_onednn(): weights are reordered once, the activation is computed while the
/// result is in registers, and maps have their channels innermost (NHWC), so nothing is
/// reordered in between. Measured on one core, this takes half the time of convolve() and
/// silu(), a quarter where maps are large and have few channels.
class FoldedConvolution {
 public:
  FoldedConvolution();  ///< None; empty() until one is assigned.
  /// @param bias  May be undefined.
  FoldedConvolution(const torch::Tensor& weight, const torch::Tensor& bias,
                    std::int64_t stride, std::int64_t groups, bool activate);
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
  std::int64_t stride_ = 1, groups_ = 1;
  bool activate_ = false;
  std::unique_ptr<Prepared> prepared_;  ///< For each size of input that was met.
};

}  // namespace segsim::perception
