#pragma once

/// @file
/// Pages, styles and scripts of the dashboard, from experiments/dashboard/pages/.

#include <string>

namespace segsim::experiments::dashboard::internal {

/// nullptr if there is none of that name.
[[nodiscard]] const char* find_asset(const std::string& name);

/// three.js as the machine that built this program has it installed (libjs-three); empty if it
/// has not.
extern const char* const kThreeLibrary;
extern const char* const kOrbitControls;

}  // namespace segsim::experiments::dashboard::internal
