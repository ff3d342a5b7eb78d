#pragma once

#include <span>

namespace segsim::sim::internal {

/// A file of sim/robots/; the build embeds them.
struct RobotText {
  const char* name;
  const char* yaml;
};

[[nodiscard]] std::span<const RobotText> robot_texts();

}  // namespace segsim::sim::internal
