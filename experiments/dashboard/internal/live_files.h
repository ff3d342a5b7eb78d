#pragma once

/// @file
/// The other end of experiments/trials/live_view.h: asks workers for pictures and reads them.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace segsim::experiments::dashboard::internal {

struct LiveFile {
  std::string worker;
  double age_s = 0.0;  ///< Since it was written.
  std::string header;  ///< JSON.
};

/// Tells the workers of the results in `folder` that somebody watches.
/// @return  False if the folder cannot be written to.
bool ask_for_live_files(const std::filesystem::path& folder);

/// Of all workers that were heard of lately, by name. Files that are none are left out.
/// @param folders  Of the results of one run.
[[nodiscard]] std::vector<LiveFile> read_live_files(
    const std::vector<std::filesystem::path>& folders);

/// One part of a worker's file, as "camera.jpg"; none if there is no such worker or part.
[[nodiscard]] std::optional<std::string> read_live_part(
    const std::vector<std::filesystem::path>& folders, const std::string& worker,
    const std::string& part);

}  // namespace segsim::experiments::dashboard::internal
