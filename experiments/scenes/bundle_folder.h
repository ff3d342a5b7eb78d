#pragma once

/// @file
/// A bundle is there wholly or not at all.

#include <filesystem>
#include <functional>

namespace segsim::experiments::scenes {

/// Has `fill` write into an empty folder beside `folder`, then gives it that name; what lay
/// there is replaced. If `fill` throws, nothing changes.
void write_bundle_folder(const std::filesystem::path& folder,
                         const std::function<void(const std::filesystem::path&)>& fill);

}  // namespace segsim::experiments::scenes
