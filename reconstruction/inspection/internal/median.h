#pragma once

#include <utility>
#include <vector>

#include "core/quantile.h"

namespace segsim::reconstruction::internal {

/// The middle value, the upper one of two. @param values  Not empty.
template <class Value>
[[nodiscard]] Value median(std::vector<Value> values) {
  return core::quantile(std::move(values), 0.5, core::Between::kNearest);
}

}  // namespace segsim::reconstruction::internal
