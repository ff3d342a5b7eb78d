#pragma once

#include <filesystem>

namespace segsim::experiments::support {

/// A file that a user names. One that is not there is looked for among the files that were
/// installed with the program, below share/segsim beside the folder of the program: so
/// "experiments/specs/flat.yaml" means the same from any folder.
/// @return  `file` itself if it is there, or nowhere.
[[nodiscard]] std::filesystem::path find_shipped(const std::filesystem::path& file);

}  // namespace segsim::experiments::support
