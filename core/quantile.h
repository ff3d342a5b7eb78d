#pragma once

/// @file
/// Values at a share of a sorted list, in the readings that this program uses. With n values
/// the first lies at share 0, the last at share 1, the k-th (from 0) at k / (n - 1).
/// sim::DurationSamples::percentile() is another: nearest rank, as deadlines are judged.

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "core/check.h"

namespace segsim::core {

/// Which value stands for a share between two.
enum class Between : unsigned char { kLower, kNearest };

/// A value that occurs. @param values  Not empty. @param share  In [0, 1].
template <class Value>
[[nodiscard]] Value quantile(std::vector<Value> values, double share, Between between) {
  SEGSIM_CHECK(!values.empty() && share >= 0.0 && share <= 1.0, std::to_string(share));
  const double at = share * static_cast<double>(values.size() - 1);
  const auto k = static_cast<std::ptrdiff_t>(between == Between::kNearest ? at + 0.5 : at);
  std::nth_element(values.begin(), values.begin() + k, values.end());
  return values[static_cast<std::size_t>(k)];
}

/// Linear between two values. @param values  Not empty. @param share  In [0, 1].
[[nodiscard]] inline double interpolated_quantile(std::vector<double> values, double share) {
  SEGSIM_CHECK(!values.empty() && share >= 0.0 && share <= 1.0, std::to_string(share));
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, values.size() - 1);
  return values[low] + (at - static_cast<double>(low)) * (values[high] - values[low]);
}

}  // namespace segsim::core
