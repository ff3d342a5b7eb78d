#pragma once

#include <filesystem>
#include <string>

namespace segsim::core {

/// A folder of its own below the system's place for temporary files, for libraries that read
/// files by name; removed with its content.
class TemporaryFolder {
 public:
  /// @throws InputError if there is no room for it.
  explicit TemporaryFolder(const std::string& prefix);
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace segsim::core
