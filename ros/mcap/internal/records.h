#pragma once

/// @file
/// Records of MCAP as bytes: an opcode, the length of the content (uint64), the content.
/// Numbers are little-endian and not aligned.

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace segsim::ros::mcap::internal {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie");

inline constexpr char kMagic[] = {'\x89', 'M', 'C', 'A', 'P', '0', '\r', '\n'};
inline constexpr std::size_t kMagicBytes = sizeof kMagic;
inline constexpr std::size_t kRecordHeadBytes = 9;
/// Channel, sequence and two times stand before the data.
inline constexpr std::size_t kMessageHeadBytes = 22;
inline constexpr std::size_t kFooterBytes = 20;

enum class Opcode : std::uint8_t {
  kHeader = 1,
  kFooter = 2,
  kSchema = 3,
  kChannel = 4,
  kMessage = 5,
  kChunk = 6,
  kMessageIndex = 7,
  kChunkIndex = 8,
  kAttachment = 9,
  kAttachmentIndex = 10,
  kStatistics = 11,
  kMetadata = 12,
  kMetadataIndex = 13,
  kSummaryOffset = 14,
  kDataEnd = 15,
};

using Bytes = std::vector<std::byte>;

template <std::integral T>
void put(Bytes& bytes, T value) {
  const auto* from = reinterpret_cast<const std::byte*>(&value);
  bytes.insert(bytes.end(), from, from + sizeof value);
}
inline void put_bytes(Bytes& bytes, const void* data, std::size_t size) {
  const auto* from = static_cast<const std::byte*>(data);
  bytes.insert(bytes.end(), from, from + size);
}
inline void put_text(Bytes& bytes, std::string_view text) {
  put(bytes, static_cast<std::uint32_t>(text.size()));
  put_bytes(bytes, text.data(), text.size());
}

/// Writes a record: its length is filled in when it ends.
class RecordScope {
 public:
  RecordScope(Bytes& bytes, Opcode opcode) : bytes_(bytes) {
    put(bytes, static_cast<std::uint8_t>(opcode));
    begin_ = bytes.size();
    put(bytes, std::uint64_t{0});
  }
  ~RecordScope() {
    const std::uint64_t length = bytes_.size() - begin_ - sizeof(std::uint64_t);
    std::memcpy(bytes_.data() + begin_, &length, sizeof length);
  }
  RecordScope(const RecordScope&) = delete;
  RecordScope& operator=(const RecordScope&) = delete;

 private:
  Bytes& bytes_;
  std::size_t begin_;
};

/// A list or map: its length in bytes (uint32) is filled in when it ends.
class ListScope {
 public:
  explicit ListScope(Bytes& bytes) : bytes_(bytes), begin_(bytes.size()) {
    put(bytes, std::uint32_t{0});
  }
  ~ListScope() {
    const auto length =
        static_cast<std::uint32_t>(bytes_.size() - begin_ - sizeof(std::uint32_t));
    std::memcpy(bytes_.data() + begin_, &length, sizeof length);
  }
  ListScope(const ListScope&) = delete;
  ListScope& operator=(const ListScope&) = delete;

 private:
  Bytes& bytes_;
  std::size_t begin_;
};

void put_texts(Bytes& bytes, const std::map<std::string, std::string>& texts);

/// Where bytes are from, for errors: a file, and the offset of their first byte in it or, for
/// what was compressed, in the records of a chunk.
struct Origin {
  const std::string* file = nullptr;
  std::uint64_t offset = 0;
  std::uint64_t chunk_offset = 0;  ///< 0: not in a chunk.

  [[nodiscard]] std::string place(std::uint64_t byte) const;
};

/// Reads numbers and texts one after another; what would pass the end is bad input.
class ByteReader {
 public:
  ByteReader(std::span<const std::byte> bytes, Origin origin)
      : bytes_(bytes), origin_(origin) {}

  template <std::integral T>
  T get() {
    T value{};
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::string text();
  std::map<std::string, std::string> texts();
  /// A list behind its length in bytes (uint32).
  ByteReader list();
  std::span<const std::byte> take(std::uint64_t size);
  std::span<const std::byte> rest() { return take(left()); }

  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }
  [[nodiscard]] std::size_t at() const { return at_; }
  [[nodiscard]] Origin origin() const { return origin_; }
  /// Names the byte that comes next.
  [[noreturn]] void fail(const std::string& expected, const std::string& found) const;

 private:
  std::span<const std::byte> bytes_;
  Origin origin_;
  std::size_t at_ = 0;
};

/// One record.
struct Record {
  Opcode opcode{};
  std::uint64_t offset = 0;  ///< Of its opcode, in the bytes that were read.
  ByteReader content;
};
Record next_record(ByteReader& bytes);

}  // namespace segsim::ros::mcap::internal
