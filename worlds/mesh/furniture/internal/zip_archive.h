#pragma once

/// @file
/// Zip files read with minizip, one entry at a time. Every size is checked before memory is
/// taken, because these files come from outside.

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <string>

namespace segsim::worlds::internal {

class ZipArchive {
 public:
  /// Lists the entries.
  /// @throws InputError if it is no zip file, is cut short, or has an entry whose name leads
  /// out of the archive ("../", "/", a drive) or whose size is above `most_entry_bytes`.
  explicit ZipArchive(const std::filesystem::path& file,
                      std::size_t most_entry_bytes = std::size_t{64} << 20U);
  ~ZipArchive();
  ZipArchive(const ZipArchive&) = delete;
  ZipArchive& operator=(const ZipArchive&) = delete;

  /// Name -> size of every file, in the order of the names.
  [[nodiscard]] const std::map<std::string, std::size_t>& sizes_bytes() const {
    return sizes_bytes_;
  }
  /// @throws InputError if there is no such entry, or its bytes are damaged.
  [[nodiscard]] std::string read(const std::string& name) const;

 private:
  struct Handle;

  std::filesystem::path file_;
  std::unique_ptr<Handle> handle_;
  std::map<std::string, std::size_t> sizes_bytes_;
};

}  // namespace segsim::worlds::internal
