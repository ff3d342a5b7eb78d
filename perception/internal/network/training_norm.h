#pragma once

/// @file
/// Batch normalisation while a network learns. libtorch's own, on a CPU, sums each channel in
/// double precision, one value after the other, and so waits for every addition. Here eight
/// channels are summed side by side, each in the same order: the same bits in half the time.

#include <torch/nn/modules/batchnorm.h>

namespace segsim::perception {

/// What `norm` makes of `x` [batch, channels, rows, columns], running statistics and gradients
/// included. Where it does not learn, for other layouts and types, and on other devices and
/// processors than x86-64 with AVX2 and FMA, libtorch does it.
[[nodiscard]] torch::Tensor apply_norm(torch::nn::BatchNorm2d& norm, const torch::Tensor& x);

}  // namespace segsim::perception
