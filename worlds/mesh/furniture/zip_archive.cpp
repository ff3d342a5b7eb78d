#include <array>

#include <minizip/unzip.h>

#include "core/error.h"
#include "worlds/mesh/furniture/internal/zip_archive.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostEntries = 100'000;
constexpr std::size_t kLongestName = 512;

/// Whether a path may be joined to a folder without leading out of it.
bool stays_inside(const std::string& name) {
  if (name.empty() || name.find('\\') != std::string::npos ||
      name.find(':') != std::string::npos || name.find('\0') != std::string::npos) {
    return false;
  }
  const fs::path path(name);
  if (path.is_absolute()) return false;
  for (const fs::path& part : path) {
    if (part == "..") return false;
  }
  return true;
}

}  // namespace

struct ZipArchive::Handle {
  explicit Handle(const fs::path& file) : zip(unzOpen64(file.c_str())) {}
  ~Handle() {
    if (zip != nullptr) unzClose(zip);
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;

  unzFile zip;
};

ZipArchive::ZipArchive(const fs::path& file, std::size_t most_entry_bytes)
    : file_(file), handle_(std::make_unique<Handle>(file)) {
  const auto fail = [&](const std::string& expected, const std::string& found) {
    throw core::InputError::expected(file_.string(), expected, found);
  };
  if (handle_->zip == nullptr) {
    fail("a whole zip file", fs::exists(file) ? "none, or one that is cut short" : "nothing");
  }
  for (int state = unzGoToFirstFile(handle_->zip); state != UNZ_END_OF_LIST_OF_FILE;
       state = unzGoToNextFile(handle_->zip)) {
    unz_file_info64 info{};
    std::array<char, kLongestName + 1> name{};
    if (state != UNZ_OK ||
        unzGetCurrentFileInfo64(handle_->zip, &info, name.data(), name.size(), nullptr, 0,
                                nullptr, 0) != UNZ_OK) {
      fail("a whole zip file", "a damaged directory");
    }
    if (info.size_filename > kLongestName) {
      fail("names of at most " + std::to_string(kLongestName) + " letters", "a longer one");
    }
    const std::string entry(name.data(), info.size_filename);
    if (!stays_inside(entry)) {
      fail("entries inside the archive", "the name \"" + entry + "\"");
    }
    if (info.uncompressed_size > most_entry_bytes) {
      fail("entries of at most " + std::to_string(most_entry_bytes) + " bytes",
           std::to_string(info.uncompressed_size) + " in " + entry);
    }
    if (sizes_bytes_.size() >= kMostEntries) {
      fail("at most " + std::to_string(kMostEntries) + " entries", "more");
    }
    if (!entry.ends_with('/')) sizes_bytes_[entry] = info.uncompressed_size;
  }
}

ZipArchive::~ZipArchive() = default;

std::string ZipArchive::read(const std::string& name) const {
  const auto known = sizes_bytes_.find(name);
  if (known == sizes_bytes_.end() || unzLocateFile(handle_->zip, name.c_str(), 1) != UNZ_OK ||
      unzOpenCurrentFile(handle_->zip) != UNZ_OK) {
    throw core::InputError::expected(file_.string(), "the entry " + name, "none");
  }
  // One byte more than stated, so that an entry which unpacks to more is noticed.
  std::string bytes(known->second + 1, '\0');
  std::size_t filled = 0;
  int count = 1;
  while (count > 0 && filled < bytes.size()) {
    count = unzReadCurrentFile(handle_->zip, bytes.data() + filled,
                               static_cast<unsigned>(bytes.size() - filled));
    if (count > 0) filled += static_cast<std::size_t>(count);
  }
  // Closing tells whether the checksum is right.
  const bool sound = unzCloseCurrentFile(handle_->zip) == UNZ_OK;
  if (count < 0 || !sound || filled != known->second) {
    throw core::InputError::expected(file_.string(), "whole bytes of " + name, "damaged ones");
  }
  bytes.resize(filled);
  return bytes;
}

}  // namespace segsim::worlds::internal
