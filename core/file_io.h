#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <ostream>
#include <span>
#include <string>

namespace segsim::core {

/// Writes a file so that it is either wholly there or unchanged: `write` fills a temporary
/// file in the same folder, which is then renamed. Parent folders are made.
/// @throws InputError if the place cannot be written; the temporary file is removed.
void write_file_atomically(const std::filesystem::path& file,
                           const std::function<void(std::ostream&)>& write);

/// For libraries that insist on a file name of their own: calls `write` with a temporary path
/// that keeps the extension of `file`, then renames it.
void write_via_temporary(const std::filesystem::path& file,
                         const std::function<void(const std::filesystem::path&)>& write);

/// @throws InputError if it cannot be read.
[[nodiscard]] std::string read_file(const std::filesystem::path& file);

/// Lower-case hexadecimal SHA-256.
[[nodiscard]] std::string sha256_hex(std::span<const std::byte> bytes);
[[nodiscard]] std::string sha256_hex(const std::string& text);
[[nodiscard]] std::string sha256_of_file(const std::filesystem::path& file);

}  // namespace segsim::core
