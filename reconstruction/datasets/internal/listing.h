#pragma once

/// @file
/// Numbered files of a folder.

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/error.h"

namespace segsim::reconstruction::internal {

/// Number -> file, for the files "<prefix><number><suffix>" of a folder with one of the
/// suffixes. Ascending by number, so that 10 follows 9.
/// @throws InputError if the folder is missing, or two files have one number.
[[nodiscard]] inline std::map<std::int64_t, std::filesystem::path> numbered_files(
    const std::filesystem::path& folder, const std::string& prefix,
    const std::vector<std::string>& suffixes) {
  if (!std::filesystem::is_directory(folder)) {
    throw core::InputError::expected(folder.string(), "a folder of images", "no such folder");
  }
  std::map<std::int64_t, std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    for (const std::string& suffix : suffixes) {
      if (name.size() <= prefix.size() + suffix.size() || !name.starts_with(prefix) ||
          !name.ends_with(suffix)) {
        continue;
      }
      const char* begin = name.data() + prefix.size();
      const char* end = name.data() + name.size() - suffix.size();
      std::int64_t number = -1;
      const auto [parsed, error] = std::from_chars(begin, end, number);
      if (error != std::errc{} || parsed != end || number < 0) continue;
      const auto [place, is_new] = files.try_emplace(number, entry.path());
      if (!is_new) {
        throw core::InputError::expected(entry.path().string(),
                                         "one image of number " + std::to_string(number),
                                         place->second.filename().string() + " too");
      }
    }
  }
  return files;
}

/// The file of that number. @throws InputError naming the folder.
[[nodiscard]] inline std::filesystem::path file_of(
    const std::map<std::int64_t, std::filesystem::path>& files, std::int64_t number,
    const std::filesystem::path& wanted) {
  const auto found = files.find(number);
  if (found != files.end()) return found->second;
  throw core::InputError::expected(wanted.string(), "a file", "none");
}

/// `file` with the first of the extensions that exists; nothing if none does.
[[nodiscard]] inline std::optional<std::filesystem::path> existing(
    std::filesystem::path file, const std::vector<std::string>& extensions) {
  for (const std::string& extension : extensions) {
    file.replace_extension(extension);
    if (std::filesystem::exists(file)) return file;
  }
  return std::nullopt;
}

}  // namespace segsim::reconstruction::internal
