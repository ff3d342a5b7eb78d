#include "ros/mcap/internal/file_index.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <tuple>
#include <utility>

#include "core/error.h"

namespace segsim::ros::mcap::internal {
namespace {

/// Messages, likewise: one takes 31 bytes before it is compressed.
constexpr std::uint64_t kFreeMessages = 1'000'000;

}  // namespace

MessageHead read_head(ByteReader& content) {
  MessageHead head;
  head.channel = content.get<std::uint16_t>();
  head.sequence = content.get<std::uint32_t>();
  head.log_time_ns = content.get<std::uint64_t>();
  head.publish_time_ns = content.get<std::uint64_t>();
  return head;
}

FileIndex::FileIndex(ChunkedFile& file) : file_(file) {
  read_start();
  file_.begin_pass();
  if (!read_summary()) {
    file_.begin_pass();
    scan();
  }
  for (auto& [id, record] : channels_) {
    if (record.schema == 0) continue;  // None.
    const auto schema = schemas_.find(record.schema);
    if (schema == schemas_.end()) {
      throw core::InputError::expected(file_.name(),
                                       "the schema of channel " + record.channel.topic,
                                       "none with number " + std::to_string(record.schema));
    }
    record.channel.schema = schema->second;
  }
  for (const Entry& entry : entries_) check_channel(entry.channel);
  std::stable_sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) {
    return std::tie(a.log_time_ns, a.chunk, a.offset) <
           std::tie(b.log_time_ns, b.chunk, b.offset);
  });
}

void FileIndex::add_entry(const Entry& entry) {
  if (entries_.size() >= kFreeMessages + file_.size() / 2) {
    throw core::InputError::expected(file_.name(), "no more messages than its bytes can hold",
                                     "more than " + std::to_string(entries_.size()));
  }
  entries_.push_back(entry);
}

void FileIndex::check_channel(std::uint16_t id) const {
  if (channels_.contains(id)) return;
  throw core::InputError::expected(file_.name(), "the channels of all messages",
                                   "none with number " + std::to_string(id));
}

void FileIndex::read_start() {
  const std::size_t start = kMagicBytes + kRecordHeadBytes;
  const Bytes bytes = file_.read(0, std::min<std::uint64_t>(start, file_.size()));
  if (bytes.size() < start || std::memcmp(bytes.data(), kMagic, kMagicBytes) != 0) {
    throw core::InputError::expected(file_.name(), "an MCAP file", "another");
  }
  ByteReader reader(std::span<const std::byte>(bytes).subspan(kMagicBytes),
                    file_.origin(kMagicBytes));
  const auto opcode = static_cast<Opcode>(reader.get<std::uint8_t>());
  const auto length = reader.get<std::uint64_t>();
  if (opcode != Opcode::kHeader) reader.fail("the record Header", "another");
  const Bytes content = file_.read(start, length);
  ByteReader header(content, file_.origin(start));
  profile_ = header.text();
  library_ = header.text();
  data_begin_ = start + length;
}

bool FileIndex::ends_with_magic() {
  if (file_.size() < data_begin_ + kMagicBytes) return false;
  const Bytes bytes = file_.read(file_.size() - kMagicBytes, kMagicBytes);
  return std::memcmp(bytes.data(), kMagic, kMagicBytes) == 0;
}

bool FileIndex::read_summary() {
  whole_ = ends_with_magic();
  if (!whole_) return false;
  const std::uint64_t footer_length = kRecordHeadBytes + kFooterBytes;
  if (file_.size() < data_begin_ + footer_length + kMagicBytes) {
    throw core::InputError::expected(file_.name(), "a footer", "none");
  }
  const std::uint64_t footer_at = file_.size() - kMagicBytes - footer_length;
  const Bytes footer_bytes = file_.read(footer_at, footer_length);
  ByteReader footer_reader(footer_bytes, file_.origin(footer_at));
  Record footer = next_record(footer_reader);
  if (footer.opcode != Opcode::kFooter || footer.content.left() != kFooterBytes) {
    footer_reader.fail("the record Footer", "another");
  }
  const auto begin = footer.content.get<std::uint64_t>();
  footer.content.get<std::uint64_t>();  // Where the offsets of groups are: all is read.
  const auto crc = footer.content.get<std::uint32_t>();
  if (begin == 0) return false;
  if (begin < data_begin_ || begin > footer_at) {
    throw core::InputError::expected(file_.origin(0).place(footer_at), "where the summary is",
                                     std::to_string(begin));
  }
  const Bytes bytes = file_.read(begin, footer_at + footer_length - begin);
  check_crc(std::span(bytes).first(bytes.size() - sizeof crc), crc,
            file_.origin(0).place(begin) + " (summary)");
  ByteReader reader(std::span<const std::byte>(bytes).first(footer_at - begin),
                    file_.origin(begin));
  return read_summary_records(reader);
}

bool FileIndex::read_summary_records(ByteReader& reader) {
  std::optional<std::uint64_t> promised;
  std::vector<std::pair<std::uint64_t, std::uint64_t>> metadata_at;
  bool any_chunk = false;
  while (reader.left() > 0) {
    Record record = next_record(reader);
    ByteReader& content = record.content;
    switch (record.opcode) {
      case Opcode::kSchema:
        add_schema(content);
        break;
      case Opcode::kChannel:
        add_channel(content);
        break;
      case Opcode::kStatistics:
        promised = content.get<std::uint64_t>();
        break;
      case Opcode::kChunkIndex:
        add_chunk_index(content);
        any_chunk = true;
        break;
      case Opcode::kMetadataIndex: {
        const auto offset = content.get<std::uint64_t>();
        metadata_at.emplace_back(offset, content.get<std::uint64_t>());
        break;
      }
      default:
        break;
    }
  }
  // Messages that lie in no chunk have no index.
  const bool all = promised ? entries_.size() == *promised : any_chunk;
  if (!all) {
    forget();
    return false;
  }
  for (const auto& [offset, length] : metadata_at) {
    const Bytes bytes = file_.read(offset, length);
    ByteReader one(bytes, file_.origin(offset));
    Record record = next_record(one);
    if (record.opcode != Opcode::kMetadata) one.fail("the record Metadata", "another");
    add_metadata(record.content);
  }
  indexed_ = true;
  return true;
}

void FileIndex::forget() {
  schemas_.clear();
  channels_.clear();
  entries_.clear();
  metadata_.clear();
}

void FileIndex::add_schema(ByteReader& content) {
  const auto id = content.get<std::uint16_t>();
  Schema schema;
  schema.name = content.text();
  schema.encoding = content.text();
  schema.text = content.text();
  const auto [at, is_new] = schemas_.try_emplace(id, schema);
  if (!is_new && at->second != schema) {
    content.fail("one schema with number " + std::to_string(id), "two");
  }
}

void FileIndex::add_channel(ByteReader& content) {
  const auto id = content.get<std::uint16_t>();
  ChannelRecord record;
  record.schema = content.get<std::uint16_t>();
  record.channel.topic = content.text();
  record.channel.message_encoding = content.text();
  record.channel.metadata = content.texts();
  const auto [at, is_new] = channels_.try_emplace(id, record);
  if (!is_new &&
      (at->second.schema != record.schema || at->second.channel != record.channel)) {
    content.fail("one channel with number " + std::to_string(id), "two");
  }
}

void FileIndex::add_metadata(ByteReader& content) {
  Metadata found;
  found.name = content.text();
  found.values = content.texts();
  metadata_.push_back(std::move(found));
}

void FileIndex::add_chunk_index(ByteReader& content) {
  content.get<std::uint64_t>();  // The span of its times: messages have theirs.
  content.get<std::uint64_t>();
  const auto chunk = content.get<std::uint64_t>();
  const auto length = content.get<std::uint64_t>();
  content.list();  // Where each channel's index is: they follow one another.
  const auto index_length = content.get<std::uint64_t>();
  if (chunk < data_begin_ || !file_.holds(chunk, length) ||
      !file_.holds(chunk + length, index_length)) {
    content.fail("a chunk and its index within the file", std::to_string(chunk) + " + " +
                                                              std::to_string(length) + " + " +
                                                              std::to_string(index_length));
  }
  if (!indexed_chunks_.insert(chunk).second) {
    content.fail("each chunk once", "that at byte " + std::to_string(chunk) + " twice");
  }
  if (index_length == 0) {
    index_records(chunk, file_.chunk(chunk));
    return;
  }
  const Bytes bytes = file_.read(chunk + length, index_length);
  ByteReader reader(bytes, file_.origin(chunk + length));
  while (reader.left() > 0) {
    Record record = next_record(reader);
    if (record.opcode != Opcode::kMessageIndex) {
      reader.fail("the record MessageIndex", "another");
    }
    const auto channel = record.content.get<std::uint16_t>();
    for (ByteReader list = record.content.list(); list.left() > 0;) {
      const auto time_ns = list.get<std::uint64_t>();
      add_entry({time_ns, chunk, list.get<std::uint64_t>(), channel});
    }
  }
}

void FileIndex::index_records(std::uint64_t chunk, std::span<const std::byte> records) {
  ByteReader reader(records, {&file_.name(), 0, chunk});
  while (reader.left() > 0) {
    Record record = next_record(reader);
    switch (record.opcode) {
      case Opcode::kSchema:
        add_schema(record.content);
        break;
      case Opcode::kChannel:
        add_channel(record.content);
        break;
      case Opcode::kMessage: {
        const MessageHead head = read_head(record.content);
        add_entry({head.log_time_ns, chunk, record.offset, head.channel});
        break;
      }
      default:
        break;
    }
  }
}

void FileIndex::scan() {
  std::uint64_t at = data_begin_;
  while (true) {
    if (!file_.holds(at, kRecordHeadBytes)) return end_of_scan(at, "a record");
    const Bytes head = file_.read(at, kRecordHeadBytes);
    ByteReader reader(head, file_.origin(at));
    const auto opcode = static_cast<Opcode>(reader.get<std::uint8_t>());
    const auto length = reader.get<std::uint64_t>();
    const std::uint64_t begin = at + kRecordHeadBytes;
    if (opcode == Opcode::kDataEnd || opcode == Opcode::kFooter) {
      if (!whole_) end_of_scan(at, "a summary and a footer");
      return;
    }
    if (opcode == Opcode{} || !file_.holds(begin, length)) {
      return end_of_scan(at, "a whole record");
    }
    scan_record(opcode, at, begin, length);
    at = begin + length;
  }
}

void FileIndex::scan_record(Opcode opcode, std::uint64_t at, std::uint64_t begin,
                            std::uint64_t length) {
  if (opcode == Opcode::kChunk) return index_records(at, file_.chunk(at));
  if (opcode == Opcode::kMessage) {
    const Bytes bytes = file_.read(begin, std::min<std::uint64_t>(length, kMessageHeadBytes));
    ByteReader content(bytes, file_.origin(begin));
    const MessageHead head_of = read_head(content);
    add_entry({head_of.log_time_ns, 0, at, head_of.channel});
    return;
  }
  if (opcode != Opcode::kSchema && opcode != Opcode::kChannel && opcode != Opcode::kMetadata) {
    return;
  }
  const Bytes bytes = file_.read(begin, length);
  ByteReader content(bytes, file_.origin(begin));
  if (opcode == Opcode::kSchema) add_schema(content);
  if (opcode == Opcode::kChannel) add_channel(content);
  if (opcode == Opcode::kMetadata) add_metadata(content);
}

void FileIndex::end_of_scan(std::uint64_t at, const std::string& expected) {
  const std::string place = file_.origin(0).place(at);
  const std::string found = "the end of the file at byte " + std::to_string(file_.size());
  if (whole_) throw core::InputError::expected(place, expected, found);
  truncation_ = core::InputError::expected(place, expected, found).what();
}

}  // namespace segsim::ros::mcap::internal
