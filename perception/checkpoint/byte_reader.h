#pragma once

/// @file
/// Little-endian numbers out of bytes that nobody vouches for.

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "core/error.h"

namespace segsim::perception {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they are");

/// Walks over bytes; every step beyond the end is a core::InputError that starts with `place`.
class ByteReader {
 public:
  ByteReader(std::string_view bytes, std::string place, std::size_t position = 0)
      : bytes_(bytes), place_(std::move(place)), position_(position) {}

  template <class Number>
  Number number() {
    Number value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::string_view take(std::size_t count) {
    if (position_ > bytes_.size() || count > bytes_.size() - position_) {
      throw core::InputError::expected(
          place_, std::to_string(count) + " more bytes at " + std::to_string(position_),
          "the end at " + std::to_string(bytes_.size()));
    }
    const std::string_view found = bytes_.substr(position_, count);
    position_ += count;
    return found;
  }
  /// Up to and without the next newline, which is skipped.
  std::string_view line() {
    const std::size_t end = bytes_.find('\n', position_);
    if (end == std::string_view::npos) {
      throw core::InputError::expected(place_, "a line at " + std::to_string(position_),
                                       "the end");
    }
    const std::string_view found = take(end - position_);
    ++position_;
    return found;
  }
  [[nodiscard]] std::size_t position() const { return position_; }
  [[nodiscard]] const std::string& place() const { return place_; }

 private:
  std::string_view bytes_;
  std::string place_;
  std::size_t position_;
};

}  // namespace segsim::perception
