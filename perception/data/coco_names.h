#pragma once

#include <string>
#include <vector>

namespace segsim::perception {

/// The 80 detection classes of COCO (Lin et al. 2014) in the order of the published weights.
[[nodiscard]] const std::vector<std::string>& coco_names();

}  // namespace segsim::perception
