#include "perception/checkpoint/zip_file.h"

#include <algorithm>
#include <limits>
#include <set>

#include "core/input/crc32.h"
#include "perception/checkpoint/byte_reader.h"

namespace segsim::perception {
namespace {

// Signatures and sizes of the parts (PKWARE APPNOTE 6.3, section 4.3).
constexpr std::uint32_t kLocalHeader = 0x04034b50, kCentralHeader = 0x02014b50,
                        kEndHeader = 0x06054b50, kEnd64Header = 0x06064b50,
                        kEnd64Locator = 0x07064b50;
constexpr std::size_t kEndBytes = 22, kLocatorBytes = 20, kLongestComment = 0xFFFF;
constexpr std::uint16_t kZip64Extra = 1;
constexpr std::uint32_t kIn64 = 0xFFFFFFFF;  // "The number is in the 64-bit extra field."
constexpr std::uint16_t kCountIn64 = 0xFFFF;

struct Directory {
  std::uint64_t offset = 0, count = 0;
};

/// Where the end record lies: it is the last one that reaches the end of the file.
std::size_t find_end(std::string_view bytes, const std::string& place) {
  const std::size_t lowest = bytes.size() > kEndBytes + kLongestComment
                                 ? bytes.size() - kEndBytes - kLongestComment
                                 : 0;
  for (std::size_t at = bytes.size() < kEndBytes ? 0 : bytes.size() - kEndBytes + 1;
       at-- > lowest;) {
    ByteReader reader(bytes, place, at);
    if (reader.number<std::uint32_t>() != kEndHeader) continue;
    reader.take(16);
    if (at + kEndBytes + reader.number<std::uint16_t>() == bytes.size()) return at;
  }
  throw core::InputError::expected(place, "a zip file with its directory at the end",
                                   "none in " + std::to_string(bytes.size()) + " bytes");
}

Directory find_directory(std::string_view bytes, const std::string& place) {
  const std::size_t end = find_end(bytes, place);
  ByteReader reader(bytes, place, end + 8);
  reader.take(2);  // Records on this disk.
  const auto count = reader.number<std::uint16_t>();
  reader.take(4);  // Bytes of the directory.
  const auto offset = reader.number<std::uint32_t>();
  if (count != kCountIn64 && offset != kIn64) return {offset, count};
  if (end < kLocatorBytes) {
    throw core::InputError::expected(place, "a 64-bit directory", "none");
  }
  ByteReader locator(bytes, place, end - kLocatorBytes);
  if (locator.number<std::uint32_t>() != kEnd64Locator) {
    throw core::InputError::expected(place, "a 64-bit directory", "none");
  }
  locator.take(4);
  ByteReader end64(bytes, place, locator.number<std::uint64_t>());
  if (end64.number<std::uint32_t>() != kEnd64Header) {
    throw core::InputError::expected(place, "a 64-bit directory", "another record");
  }
  end64.take(28);
  const auto count64 = end64.number<std::uint64_t>();
  end64.take(8);
  return {end64.number<std::uint64_t>(), count64};
}

struct Entry {
  ZipRecord record;
  std::uint64_t local_offset = 0;
};

/// Replaces numbers that say kIn64 by those of the extra field, in its order.
void apply_extra(std::string_view extra, const std::string& place, std::uint64_t& size,
                 std::uint64_t& stored, std::uint64_t& offset) {
  ByteReader reader(extra, place);
  while (reader.position() + 4 <= extra.size()) {
    const auto kind = reader.number<std::uint16_t>();
    const auto bytes = reader.number<std::uint16_t>();
    ByteReader body(reader.take(bytes), place);
    if (kind != kZip64Extra) continue;
    for (std::uint64_t* value : {&size, &stored, &offset}) {
      if (*value == kIn64) *value = body.number<std::uint64_t>();
    }
  }
}

Entry read_entry(ByteReader& reader) {
  const std::string& place = reader.place();
  if (reader.number<std::uint32_t>() != kCentralHeader) {
    throw core::InputError::expected(place, "a record of the zip directory", "other bytes");
  }
  reader.take(4);
  const auto flags = reader.number<std::uint16_t>(), method = reader.number<std::uint16_t>();
  reader.take(4);
  Entry entry;
  entry.record.crc = reader.number<std::uint32_t>();
  std::uint64_t stored = reader.number<std::uint32_t>(), size = reader.number<std::uint32_t>();
  const auto name_bytes = reader.number<std::uint16_t>();
  const auto extra_bytes = reader.number<std::uint16_t>();
  const auto comment_bytes = reader.number<std::uint16_t>();
  reader.take(8);
  std::uint64_t offset = reader.number<std::uint32_t>();
  entry.record.name = std::string(reader.take(name_bytes));
  apply_extra(reader.take(extra_bytes), place, size, stored, offset);
  reader.take(comment_bytes);
  constexpr std::uint16_t kEncrypted = 1;
  entry.record.plain = method == 0 && (flags & kEncrypted) == 0 && stored == size;
  entry.record.size = stored;
  entry.local_offset = offset;
  return entry;
}

/// Steps over the local header to the data.
void locate_data(std::string_view bytes, const std::string& place, Entry& entry) {
  ByteReader reader(bytes, place, entry.local_offset);
  if (reader.number<std::uint32_t>() != kLocalHeader) {
    throw core::InputError::expected(place + ": record " + entry.record.name, "its header",
                                     "other bytes");
  }
  reader.take(22);
  const auto name_bytes = reader.number<std::uint16_t>();
  const auto extra_bytes = reader.number<std::uint16_t>();
  if (reader.take(name_bytes) != entry.record.name) {
    throw core::InputError::expected(place + ": record " + entry.record.name,
                                     "its name before the data", "another");
  }
  reader.take(extra_bytes);
  entry.record.offset = reader.position();
  reader.take(entry.record.size);
}

}  // namespace

bool is_zip(std::string_view bytes) { return bytes.substr(0, 4) == "PK\x03\x04"; }

std::vector<ZipRecord> list_zip(std::string_view bytes, const std::string& place) {
  const Directory directory = find_directory(bytes, place);
  ByteReader reader(bytes, place, directory.offset);
  std::vector<ZipRecord> records;
  std::set<std::string> names;
  for (std::uint64_t i = 0; i < directory.count; ++i) {
    Entry entry = read_entry(reader);
    locate_data(bytes, place, entry);
    if (!names.insert(entry.record.name).second) {
      throw core::InputError::expected(place, "each record once",
                                       entry.record.name + " again");
    }
    records.push_back(std::move(entry.record));
  }
  return records;
}

std::string_view read_record(std::string_view bytes, const ZipRecord& record,
                             const std::string& place) {
  if (!record.plain) {
    throw core::InputError::expected(place + ": record " + record.name,
                                     "one that is neither compressed nor encrypted",
                                     "another");
  }
  const std::string_view data = bytes.substr(record.offset, record.size);
  if (core::crc32(data) != record.crc) {
    throw core::InputError::expected(place + ": record " + record.name, "the stated checksum",
                                     "another: the file is damaged");
  }
  return data;
}

}  // namespace segsim::perception
