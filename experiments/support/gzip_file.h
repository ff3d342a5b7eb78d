#pragma once

/// @file
/// Gzip files in one piece (zlib).

#include <filesystem>
#include <string>

namespace segsim::experiments::support {

/// The unpacked contents; several members, one after another, count as one file.
/// @throws core::InputError if it cannot be read, is no gzip file, is damaged or cut short, or
/// unpacks to more than `most_bytes`.
[[nodiscard]] std::string read_gzip(const std::filesystem::path& file,
                                    std::size_t most_bytes = std::size_t{1} << 30U);

/// Written atomically; without a time or name inside, so equal texts give equal files.
void write_gzip(const std::filesystem::path& file, const std::string& text);

}  // namespace segsim::experiments::support
