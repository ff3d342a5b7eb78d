#pragma once

#include <map>
#include <string>

namespace segsim::worlds {

/// Libraries that the simulated world depends on, with the versions that this was compiled
/// against. Recast has no version; what it made is part of a scene's hash.
[[nodiscard]] std::map<std::string, std::string> library_versions();

}  // namespace segsim::worlds
