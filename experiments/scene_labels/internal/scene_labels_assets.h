#pragma once

/// @file
/// Files of experiments/scene_labels/pages.

#include <string>

namespace segsim::experiments::scene_labels::internal {

/// nullptr if there is none of that name.
[[nodiscard]] const char* find_asset(const std::string& name);

}  // namespace segsim::experiments::scene_labels::internal
