#pragma once

/// @file
/// Classes of a scene that a robot can be asked to find.

#include <span>
#include <string>
#include <vector>

#include "core/scene_bundle.h"

namespace segsim::core {

/// Names of the classes that have instances, in their order.
[[nodiscard]] inline std::vector<std::string> thing_names(
    std::span<const SceneClass> classes) {
  std::vector<std::string> names;
  for (const SceneClass& c : classes) {
    if (c.thing) names.push_back(c.name);
  }
  return names;
}

}  // namespace segsim::core
