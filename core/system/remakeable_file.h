#pragma once

/// @file
/// The exception to core/file_io.h, whose files are on the disk when it returns: pictures and
/// frames, of which there are thousands, which can be made again, and for each of which
/// waiting for a disk (1 to 10 ms) would cost about what making it does. A power cut may leave
/// them empty, which every reader of pictures refuses.

#include <filesystem>
#include <functional>
#include <ostream>

namespace segsim::core {

/// As write_file_atomically(), without waiting for the disk.
void write_remakeable_file(const std::filesystem::path& file,
                           const std::function<void(std::ostream&)>& write);

/// As write_via_temporary(), without waiting for the disk.
void write_remakeable_via_temporary(
    const std::filesystem::path& file,
    const std::function<void(const std::filesystem::path&)>& write);

}  // namespace segsim::core
