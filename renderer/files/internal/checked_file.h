#pragma once

/// @file
/// Binary files that notice damage, little-endian:
///
///     8 bytes  magic
///
///     u32      version
///
///     u64      payload bytes
///
///     64 bytes SHA-256 of the payload, lower-case hexadecimal
///
///     payload

#include <bit>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <string_view>

#include "core/error.h"

namespace segsim::renderer::internal {

static_assert(std::endian::native == std::endian::little);

class ByteWriter {
 public:
  template <class T>
  void put(const T& value) {
    const auto at = bytes.size();
    bytes.resize(at + sizeof value);
    std::memcpy(bytes.data() + at, &value, sizeof value);
  }

  std::string bytes;
};

class ByteReader {
 public:
  /// @param place  Of messages. Both must outlive the reader.
  ByteReader(const std::string& bytes, const std::string& place)
      : bytes_(bytes), place_(place) {}

  /// @throws core::InputError at the end of the bytes.
  template <class T>
  T take() {
    if (bytes_.size() - at_ < sizeof(T)) {
      throw core::InputError::expected(
          place_, "more than " + std::to_string(bytes_.size()) + " bytes of payload",
          "its end");
    }
    T value;
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  /// @throws core::InputError if bytes are left.
  void expect_end() const {
    if (at_ == bytes_.size()) return;
    throw core::InputError::expected(place_, std::to_string(at_) + " bytes of payload",
                                     std::to_string(bytes_.size()));
  }

 private:
  const std::string& bytes_;
  const std::string& place_;
  std::size_t at_ = 0;
};

struct CheckedFile {
  std::uint32_t version = 0;
  std::string payload;
};

/// @param magic  Of 8 characters.
void write_checked_file(const std::filesystem::path& file, std::string_view magic,
                        std::uint32_t version, const std::string& payload);

/// @param kind  In words, for messages: "a panoptic model".
/// @throws core::InputError for a file that is missing, of another kind, newer than `newest`,
///     cut short or damaged.
[[nodiscard]] CheckedFile read_checked_file(const std::filesystem::path& file,
                                            std::string_view magic, const std::string& kind,
                                            std::uint32_t newest);

}  // namespace segsim::renderer::internal
