#include "perception/models/internal/resample.h"

#include <algorithm>
#include <cmath>

namespace segsim::perception {
namespace {

double kernel_value(const ResampleRule& rule, double x) {
  x = std::abs(x);
  if (rule.kernel == Kernel::kLinear) return std::max(0.0, 1.0 - x);
  const double a = rule.cubic_a;  // Keys' cubic convolution.
  if (x <= 1.0) return ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0;
  if (x < 2.0) return ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a;
  return 0.0;
}

}  // namespace

Resampling make_resampling(std::int64_t input, std::int64_t output, const ResampleRule& rule) {
  Resampling result;
  if (rule.kernel == Kernel::kNearest) {
    result.taps = 1;
    for (std::int64_t i = 0; i < output; ++i) {
      result.indices.push_back(
          std::clamp<std::int64_t>(rule.nearest(rule.to_input(i)), 0, input - 1));
    }
    result.weights.assign(static_cast<std::size_t>(output), 1.0F);
    return result;
  }
  const double stretch = rule.antialias ? std::max(1.0, 1.0 / rule.scale) : 1.0;
  const double support = (rule.kernel == Kernel::kLinear ? 1.0 : 2.0) * stretch;
  // A window of 2 * support has at most one sample more than its length, rounded up.
  result.taps = static_cast<std::int64_t>(std::ceil(2.0 * support)) + 1;
  std::vector<double> weights(static_cast<std::size_t>(result.taps));
  for (std::int64_t i = 0; i < output; ++i) {
    const double place = rule.to_input(i);
    const auto first = static_cast<std::int64_t>(std::ceil(place - support));
    double sum = 0.0;
    for (std::int64_t k = 0; k < result.taps; ++k) {
      const std::int64_t at = first + k;
      double weight = kernel_value(rule, (static_cast<double>(at) - place) / stretch);
      if ((rule.exclude_outside || rule.antialias) && (at < 0 || at >= input)) weight = 0.0;
      weights[static_cast<std::size_t>(k)] = weight;
      sum += weight;
      result.indices.push_back(std::clamp<std::int64_t>(at, 0, input - 1));
    }
    for (const double weight : weights) {
      result.weights.push_back(static_cast<float>(sum == 0.0 ? 0.0 : weight / sum));
    }
  }
  return result;
}

}  // namespace segsim::perception
