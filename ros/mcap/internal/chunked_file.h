#pragma once

/// @file
/// An MCAP file as bytes from anywhere in it, and its chunks, decompressed.

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <list>
#include <span>
#include <string>
#include <utility>

#include "ros/mcap/internal/records.h"

namespace segsim::ros::mcap::internal {

/// @param stored  0: the writer made none.
/// @throws core::InputError naming the place if the bytes have another checksum.
void check_crc(std::span<const std::byte> bytes, std::uint32_t stored,
               const std::string& place);

class ChunkedFile {
 public:
  /// @throws core::InputError if it cannot be read.
  explicit ChunkedFile(const std::filesystem::path& file);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }
  [[nodiscard]] Origin origin(std::uint64_t offset) const { return {&name_, offset, 0}; }
  [[nodiscard]] bool holds(std::uint64_t offset, std::uint64_t length) const {
    return offset <= size_ && length <= size_ - offset;
  }
  /// @throws core::InputError beyond the end of the file.
  [[nodiscard]] Bytes read(std::uint64_t offset, std::uint64_t length);

  /// Before all chunks, or some, are gone through: what may be decompressed on the way is
  /// limited.
  void begin_pass();
  /// The records of the chunk at that place, from the cache or the file; valid until the next
  /// call.
  /// @throws core::InputError for another record, more than may be decompressed, or damage.
  std::span<const std::byte> chunk(std::uint64_t offset);

 private:
  [[nodiscard]] Bytes read_chunk(std::uint64_t offset);

  std::string name_;
  std::ifstream stream_;
  std::uint64_t size_ = 0;
  std::uint64_t budget_bytes_ = 0;                    ///< That may still be decompressed.
  std::list<std::pair<std::uint64_t, Bytes>> cache_;  ///< The one used last comes first.
  std::size_t cached_bytes_ = 0;
};

}  // namespace segsim::ros::mcap::internal
