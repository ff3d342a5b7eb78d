#pragma once

/// @file
/// Classes of a scene that a robot can be asked to find.

#include <span>
#include <string>
#include <vector>

#include "core/scene_bundle.h"

namespace segsim::sim {

/// Names of the classes of things, in their order, whether the scene has one or not.
[[nodiscard]] inline std::vector<std::string> thing_names(
    std::span<const core::SceneClass> classes) {
  std::vector<std::string> names;
  for (const core::SceneClass& c : classes) {
    if (c.thing) names.push_back(c.name);
  }
  return names;
}

}  // namespace segsim::sim
