#pragma once

/// @file
/// Resampling of one axis as weighted sums of samples: what ONNX Resize defines, and what the
/// image libraries do from which models got their training images (Pillow: kCubic with
/// antialias and a = -0.5; see preprocess.h).

#include <cstdint>
#include <functional>
#include <vector>

namespace segsim::perception {

enum class Kernel : std::uint8_t { kNearest, kLinear, kCubic };

/// output[i] = sum over k of weights[i * taps + k] * input[indices[i * taps + k]]
struct Resampling {
  std::int64_t taps = 0;
  std::vector<std::int64_t> indices;
  std::vector<float> weights;
};

struct ResampleRule {
  Kernel kernel = Kernel::kLinear;
  double cubic_a = -0.75;
  bool exclude_outside =
      false;               ///< Samples outside have no weight, instead of the edge's value.
  bool antialias = false;  ///< The kernel is as wide as an output sample.
  /// Place in the input, in samples, of output sample i.
  std::function<double(std::int64_t)> to_input;
  /// kNearest: the sample at a place.
  std::function<std::int64_t(double)> nearest;
  double scale = 1.0;  ///< Output samples per input sample; for antialias.
};

/// @param input, output  Numbers of samples, > 0.
[[nodiscard]] Resampling make_resampling(std::int64_t input, std::int64_t output,
                                         const ResampleRule& rule);

}  // namespace segsim::perception
