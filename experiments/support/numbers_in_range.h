#pragma once

/// @file
/// Numbers of a configuration file that must lie in a range, bounds included.
/// @throws InputError naming file, line, key, the range and what stands there.

#include <cstdint>
#include <string>

#include "core/config.h"
#include "core/formatted.h"

namespace segsim::experiments::support {

[[nodiscard]] inline double number_within(const core::ConfigNode& node, const std::string& key,
                                          double fallback, double low, double high) {
  const double value = node.number_or(key, fallback);
  if (!(value >= low && value <= high)) {
    node.child(key).fail(core::print("a number in [%g, %g]", low, high), node.text(key));
  }
  return value;
}

[[nodiscard]] inline int count_within(const core::ConfigNode& node, const std::string& key,
                                      int fallback, int low, int high) {
  const std::int64_t value = node.integer_or(key, fallback);
  if (value < low || value > high) {
    node.child(key).fail(core::print("an integer in [%d, %d]", low, high), node.text(key));
  }
  return static_cast<int>(value);
}

}  // namespace segsim::experiments::support
