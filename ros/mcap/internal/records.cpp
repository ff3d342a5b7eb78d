#include "ros/mcap/internal/records.h"

#include "core/error.h"

namespace segsim::ros::mcap::internal {

void put_texts(Bytes& bytes, const std::map<std::string, std::string>& texts) {
  const ListScope list(bytes);
  for (const auto& [key, value] : texts) {
    put_text(bytes, key);
    put_text(bytes, value);
  }
}

std::string Origin::place(std::uint64_t byte) const {
  const std::string at = ": byte " + std::to_string(offset + byte);
  if (chunk_offset == 0) return *file + at;
  return *file + ": chunk at byte " + std::to_string(chunk_offset) + at;
}

void ByteReader::fail(const std::string& expected, const std::string& found) const {
  throw core::InputError::expected(origin_.place(at_), expected, found);
}

std::span<const std::byte> ByteReader::take(std::uint64_t size) {
  if (size > left()) fail(std::to_string(size) + " bytes more", std::to_string(left()));
  const auto taken = bytes_.subspan(at_, size);
  at_ += size;
  return taken;
}

std::string ByteReader::text() {
  const auto bytes = take(get<std::uint32_t>());
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

ByteReader ByteReader::list() {
  const auto length = get<std::uint32_t>();
  Origin origin = origin_;
  origin.offset += at_;
  return {take(length), origin};
}

std::map<std::string, std::string> ByteReader::texts() {
  std::map<std::string, std::string> texts;
  for (ByteReader entries = list(); entries.left() > 0;) {
    std::string key = entries.text();
    texts[std::move(key)] = entries.text();
  }
  return texts;
}

Record next_record(ByteReader& bytes) {
  const std::uint64_t offset = bytes.at();
  const auto opcode = bytes.get<std::uint8_t>();
  if (opcode == 0) bytes.fail("a record", "opcode 0");
  const auto length = bytes.get<std::uint64_t>();
  Origin origin = bytes.origin();
  origin.offset += bytes.at();
  return {static_cast<Opcode>(opcode), offset, ByteReader(bytes.take(length), origin)};
}

}  // namespace segsim::ros::mcap::internal
