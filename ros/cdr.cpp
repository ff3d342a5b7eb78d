#include "ros/cdr.h"

#include <algorithm>
#include <limits>

#include "core/check.h"
#include "core/error.h"

namespace segsim::ros::internal {

std::uint32_t CdrEncoder::length_of(std::size_t size) {
  SEGSIM_CHECK(size <= std::numeric_limits<std::uint32_t>::max(), std::to_string(size));
  return static_cast<std::uint32_t>(size);
}

CdrDecoder::CdrDecoder(std::span<const std::byte> bytes, std::string place)
    : place_(std::move(place)) {
  if (bytes.size() < kEncapsulationBytes) {
    fail("an encapsulation of 4 bytes", std::to_string(bytes.size()) + " bytes");
  }
  const auto kind =
      std::to_integer<unsigned>(bytes[0]) << 8U | std::to_integer<unsigned>(bytes[1]);
  // Bytes 2 and 3 are options, which plain CDR does not use.
  if (kind > 1)
    fail("plain CDR (encapsulation 0 or 1)", "encapsulation " + std::to_string(kind));
  swapped_ = kind == 0;
  payload_ = bytes.subspan(kEncapsulationBytes);
}

void CdrDecoder::fail(const std::string& expected, const std::string& found) const {
  std::string where = place_ + ", byte " + std::to_string(at_ + kEncapsulationBytes);
  for (std::size_t k = 0; k < path_.size(); ++k)
    where += (k == 0 ? ", " : ".") + std::string(path_[k]);
  throw core::InputError::expected(where, expected, found);
}

void CdrDecoder::align(std::size_t size) {
  const std::size_t past = at_ % size;
  if (past != 0) take(size - past);
}

const std::byte* CdrDecoder::take(std::size_t size) {
  const std::size_t left = payload_.size() - at_;
  if (size > left) {
    fail(std::to_string(size) + " bytes more", std::to_string(left));
  }
  const std::byte* taken = payload_.data() + at_;
  at_ += size;
  return taken;
}

bool CdrDecoder::get_bool() {
  const auto value = std::to_integer<unsigned>(*take(1));
  if (value > 1) fail("false or true (0 or 1)", std::to_string(value));
  return value == 1;
}

std::uint32_t CdrDecoder::get_length(const char* what) {
  std::uint32_t length = 0;
  get(length);
  const std::size_t left = payload_.size() - at_;
  if (length > left) {
    fail("at most " + std::to_string(left) + " " + what, std::to_string(length));
  }
  return length;
}

void CdrDecoder::get(std::string& text) {
  const std::uint32_t length = get_length("characters");
  if (length == 0) return text.clear();  // Some writers leave the closing zero out of nothing.
  const auto* from = reinterpret_cast<const char*>(take(length));
  if (from[length - 1] != '\0') fail("a text that ends with a zero", "another character");
  text.assign(from, length - 1);
}

void CdrDecoder::get_bounded(std::string& text, std::size_t most) {
  get(text);
  if (text.size() > most) {
    fail("at most " + std::to_string(most) + " characters", std::to_string(text.size()));
  }
}

void CdrDecoder::finish() const {
  // Transports fill messages up to whole words.
  const std::size_t left = payload_.size() - at_;
  if (left > 3) fail("the end of the message", std::to_string(left) + " bytes more");
}

void CdrDecoder::swap_bytes(void* values, std::size_t count, std::size_t size) {
  auto* bytes = static_cast<std::byte*>(values);
  for (std::size_t k = 0; k < count; ++k)
    std::reverse(bytes + k * size, bytes + (k + 1) * size);
}

}  // namespace segsim::ros::internal
