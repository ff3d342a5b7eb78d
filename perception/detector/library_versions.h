#pragma once

#include <map>
#include <string>

namespace segsim::perception {

/// Libraries that detections depend on, with the versions that this was compiled against.
[[nodiscard]] std::map<std::string, std::string> library_versions();

}  // namespace segsim::perception
