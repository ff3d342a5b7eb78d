#pragma once

#include <filesystem>

namespace segsim::core {

/// Waits until a file, or the names in a folder, would survive a power cut. core/file_io.h
/// does this by itself; this is for folders that are renamed as a whole.
/// @throws InputError if the disk reports an error.
void sync_to_disk(const std::filesystem::path& file_or_folder);

}  // namespace segsim::core
