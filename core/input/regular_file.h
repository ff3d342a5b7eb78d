#pragma once

/// @file
/// Whether a name that stands in a file or a flag may be opened at all.

#include <filesystem>
#include <system_error>

namespace segsim::core {

/// False for what is not there, and for folders, pipes and devices: /dev/zero has no end, and
/// opening a pipe waits for somebody to write into it. A name that the system cannot look up
/// (longer than NAME_MAX) is no file either.
[[nodiscard]] inline bool can_be_read(const std::filesystem::path& file) {
  std::error_code error;
  return std::filesystem::is_regular_file(file, error) && !error;
}

}  // namespace segsim::core
