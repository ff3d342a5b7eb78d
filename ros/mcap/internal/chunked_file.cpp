#include "ros/mcap/internal/chunked_file.h"

#include <algorithm>

#include <zlib.h>

#include "core/error.h"
#include "core/input/regular_file.h"
#include "ros/mcap/internal/compression.h"

namespace segsim::ros::mcap::internal {
namespace {

/// Chunks that lie in memory, decompressed: files of several writers have chunks whose times
/// overlap, and messages are wanted in order of time.
constexpr std::size_t kCacheBytes = std::size_t{128} << 20U;

/// Of one chunk, decompressed: hundreds of times what recorders make by default.
constexpr std::uint64_t kMostChunkBytes = std::uint64_t{256} << 20U;
/// Of all chunks that are decompressed on the way through a file, from the start or in order
/// of time: more than any recording compresses to, so that a small file cannot take long.
constexpr std::uint64_t kFreeBytes = std::uint64_t{512} << 20U, kMostTimesFileSize = 200;

std::string hexadecimal(std::uint32_t value) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (int shift = 28; shift >= 0; shift -= 4) text += kDigits[(value >> shift) & 15U];
  return text;
}

}  // namespace

void check_crc(std::span<const std::byte> bytes, std::uint32_t stored,
               const std::string& place) {
  if (stored == 0) return;
  const auto crc = static_cast<std::uint32_t>(
      ::crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
  if (crc == stored) return;
  throw core::InputError::expected(place, "checksum " + hexadecimal(stored), hexadecimal(crc));
}

ChunkedFile::ChunkedFile(const std::filesystem::path& file) : name_(file.string()) {
  if (core::can_be_read(file)) stream_.open(file, std::ios::binary);
  if (!stream_.is_open()) throw core::InputError::expected(name_, "a readable file", "none");
  size_ = std::filesystem::file_size(file);
}

Bytes ChunkedFile::read(std::uint64_t offset, std::uint64_t length) {
  if (!holds(offset, length)) {
    throw core::InputError::expected(origin(0).place(offset),
                                     std::to_string(length) + " bytes",
                                     std::to_string(size_) + " bytes in the file");
  }
  Bytes bytes(static_cast<std::size_t>(length));
  stream_.clear();
  stream_.seekg(static_cast<std::streamoff>(offset));
  stream_.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(length));
  if (!stream_) throw core::InputError::expected(name_, "a file that can be read", "an error");
  return bytes;
}

void ChunkedFile::begin_pass() { budget_bytes_ = kFreeBytes + kMostTimesFileSize * size_; }

std::span<const std::byte> ChunkedFile::chunk(std::uint64_t offset) {
  const auto found = std::find_if(cache_.begin(), cache_.end(),
                                  [offset](const auto& held) { return held.first == offset; });
  if (found != cache_.end()) {
    cache_.splice(cache_.begin(), cache_, found);
    return cache_.front().second;
  }
  cache_.emplace_front(offset, read_chunk(offset));
  cached_bytes_ += cache_.front().second.size();
  while (cached_bytes_ > kCacheBytes && cache_.size() > 1) {
    cached_bytes_ -= cache_.back().second.size();
    cache_.pop_back();
  }
  return cache_.front().second;
}

Bytes ChunkedFile::read_chunk(std::uint64_t offset) {
  const Bytes head = read(offset, kRecordHeadBytes);
  ByteReader reader(head, origin(offset));
  if (reader.get<std::uint8_t>() != static_cast<std::uint8_t>(Opcode::kChunk)) {
    reader.fail("the record Chunk", "another");
  }
  const std::uint64_t begin = offset + kRecordHeadBytes;
  const Bytes bytes = read(begin, reader.get<std::uint64_t>());
  ByteReader content(bytes, origin(begin));
  content.get<std::uint64_t>();
  content.get<std::uint64_t>();
  const auto size = content.get<std::uint64_t>();
  const auto crc = content.get<std::uint32_t>();
  const std::string compression = content.text();
  const auto stored_size = content.get<std::uint64_t>();
  const std::string place = origin(0).place(offset) + " (chunk)";
  const std::uint64_t most = std::min(kMostChunkBytes, budget_bytes_);
  if (size > most) {
    throw core::InputError::expected(
        place, "at most " + std::to_string(most) + " bytes, decompressed",
        std::to_string(size));
  }
  budget_bytes_ -= size;
  Bytes records = decompress(content.take(stored_size), compression, size, place);
  check_crc(records, crc, place);
  return records;
}

}  // namespace segsim::ros::mcap::internal
