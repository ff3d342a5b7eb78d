#pragma once

/// @file
/// Files of experiments/web/pages.

#include <string>

namespace segsim::experiments::web::internal {

/// nullptr if there is none of that name.
[[nodiscard]] const char* find_asset(const std::string& name);

}  // namespace segsim::experiments::web::internal
