#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace segsim::reconstruction::internal {

/// The middle value, the upper one of two. @param values  Not empty.
template <class Value>
[[nodiscard]] Value median(std::vector<Value> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace segsim::reconstruction::internal
