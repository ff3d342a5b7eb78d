#include "ros/mcap/mcap_reader.h"

#include <algorithm>
#include <fstream>
#include <list>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include <zlib.h>

#include "core/error.h"
#include "core/input/regular_file.h"
#include "ros/mcap/internal/compression.h"
#include "ros/mcap/internal/records.h"

namespace segsim::ros::mcap {
namespace {

namespace fs = std::filesystem;
using internal::ByteReader;
using internal::Bytes;
using internal::kFooterBytes;
using internal::kMagicBytes;
using internal::kMessageHeadBytes;
using internal::kRecordHeadBytes;
using internal::next_record;
using internal::Opcode;
using internal::Origin;
using internal::Record;

/// Chunks that lie in memory, decompressed: files of several writers have chunks whose times
/// overlap, and messages are wanted in order of time.
constexpr std::size_t kCacheBytes = std::size_t{128} << 20U;

/// Of one chunk, decompressed: hundreds of times what recorders make by default.
constexpr std::uint64_t kMostChunkBytes = std::uint64_t{256} << 20U;
/// Of all chunks that are decompressed on the way through a file, from the start or in order
/// of time: more than any recording compresses to, so that a small file cannot take long.
constexpr std::uint64_t kFreeBytes = std::uint64_t{512} << 20U, kMostTimesFileSize = 200;
/// Messages, likewise: one takes 31 bytes before it is compressed.
constexpr std::uint64_t kFreeMessages = 1'000'000;

std::string hexadecimal(std::uint32_t value) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (int shift = 28; shift >= 0; shift -= 4) text += kDigits[(value >> shift) & 15U];
  return text;
}

/// @param stored  0: the writer made none.
void check_crc(std::span<const std::byte> bytes, std::uint32_t stored,
               const std::string& place) {
  if (stored == 0) return;
  const auto crc = static_cast<std::uint32_t>(
      ::crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
  if (crc == stored) return;
  throw core::InputError::expected(place, "checksum " + hexadecimal(stored), hexadecimal(crc));
}

/// Bytes of a file from anywhere in it.
class RandomAccessFile {
 public:
  explicit RandomAccessFile(const fs::path& file) : name_(file.string()) {
    if (core::can_be_read(file)) stream_.open(file, std::ios::binary);
    if (!stream_.is_open()) throw core::InputError::expected(name_, "a readable file", "none");
    size_ = fs::file_size(file);
  }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }
  [[nodiscard]] Origin origin(std::uint64_t offset) const { return {&name_, offset, 0}; }
  [[nodiscard]] bool holds(std::uint64_t offset, std::uint64_t length) const {
    return offset <= size_ && length <= size_ - offset;
  }
  [[nodiscard]] Bytes read(std::uint64_t offset, std::uint64_t length) {
    if (!holds(offset, length)) {
      throw core::InputError::expected(origin(0).place(offset),
                                       std::to_string(length) + " bytes",
                                       std::to_string(size_) + " bytes in the file");
    }
    Bytes bytes(static_cast<std::size_t>(length));
    stream_.clear();
    stream_.seekg(static_cast<std::streamoff>(offset));
    stream_.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(length));
    if (!stream_)
      throw core::InputError::expected(name_, "a file that can be read", "an error");
    return bytes;
  }

 private:
  std::string name_;
  std::ifstream stream_;
  std::uint64_t size_ = 0;
};

/// A message and where it is.
struct Entry {
  std::uint64_t log_time_ns = 0;
  std::uint64_t chunk = 0;   ///< Offset of its chunk in the file; 0: it lies in none.
  std::uint64_t offset = 0;  ///< Of its record, in the file or the chunk's records.
  std::uint16_t channel = 0;
};

struct MessageHead {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_time_ns = 0, publish_time_ns = 0;
};

MessageHead read_head(ByteReader& content) {
  MessageHead head;
  head.channel = content.get<std::uint16_t>();
  head.sequence = content.get<std::uint32_t>();
  head.log_time_ns = content.get<std::uint64_t>();
  head.publish_time_ns = content.get<std::uint64_t>();
  return head;
}

struct ChannelRecord {
  std::uint16_t schema = 0;
  Channel channel;
};

}  // namespace

struct Reader::Impl {
  explicit Impl(const fs::path& path) : file(path) {
    read_start();
    begin_pass();
    if (!read_summary()) {
      begin_pass();
      scan();
    }
    for (auto& [id, record] : channels) {
      if (record.schema == 0) continue;  // None.
      const auto schema = schemas.find(record.schema);
      if (schema == schemas.end()) {
        throw core::InputError::expected(file.name(),
                                         "the schema of channel " + record.channel.topic,
                                         "none with number " + std::to_string(record.schema));
      }
      record.channel.schema = schema->second;
    }
    for (const Entry& entry : entries) check_channel(entry.channel);
    std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
      return std::tie(a.log_time_ns, a.chunk, a.offset) <
             std::tie(b.log_time_ns, b.chunk, b.offset);
    });
  }

  /// Before all chunks, or some, are gone through.
  void begin_pass() { budget_bytes = kFreeBytes + kMostTimesFileSize * file.size(); }

  void add_entry(const Entry& entry) {
    if (entries.size() >= kFreeMessages + file.size() / 2) {
      throw core::InputError::expected(file.name(), "no more messages than its bytes can hold",
                                       "more than " + std::to_string(entries.size()));
    }
    entries.push_back(entry);
  }

  void check_channel(std::uint16_t id) const {
    if (channels.contains(id)) return;
    throw core::InputError::expected(file.name(), "the channels of all messages",
                                     "none with number " + std::to_string(id));
  }

  void read_start() {
    const std::size_t start = kMagicBytes + kRecordHeadBytes;
    const Bytes bytes = file.read(0, std::min<std::uint64_t>(start, file.size()));
    if (bytes.size() < start ||
        std::memcmp(bytes.data(), internal::kMagic, kMagicBytes) != 0) {
      throw core::InputError::expected(file.name(), "an MCAP file", "another");
    }
    ByteReader reader(std::span<const std::byte>(bytes).subspan(kMagicBytes),
                      file.origin(kMagicBytes));
    const auto opcode = static_cast<Opcode>(reader.get<std::uint8_t>());
    const auto length = reader.get<std::uint64_t>();
    if (opcode != Opcode::kHeader) reader.fail("the record Header", "another");
    const Bytes content = file.read(start, length);
    ByteReader header(content, file.origin(start));
    profile = header.text();
    library = header.text();
    data_begin = start + length;
  }

  [[nodiscard]] bool ends_with_magic() {
    if (file.size() < data_begin + kMagicBytes) return false;
    const Bytes bytes = file.read(file.size() - kMagicBytes, kMagicBytes);
    return std::memcmp(bytes.data(), internal::kMagic, kMagicBytes) == 0;
  }

  /// @return  Whether the file has an index of all its messages.
  bool read_summary() {
    whole = ends_with_magic();
    if (!whole) return false;
    const std::uint64_t footer_length = kRecordHeadBytes + kFooterBytes;
    if (file.size() < data_begin + footer_length + kMagicBytes) {
      throw core::InputError::expected(file.name(), "a footer", "none");
    }
    const std::uint64_t footer_at = file.size() - kMagicBytes - footer_length;
    const Bytes footer_bytes = file.read(footer_at, footer_length);
    ByteReader footer_reader(footer_bytes, file.origin(footer_at));
    Record footer = next_record(footer_reader);
    if (footer.opcode != Opcode::kFooter || footer.content.left() != kFooterBytes) {
      footer_reader.fail("the record Footer", "another");
    }
    const auto begin = footer.content.get<std::uint64_t>();
    footer.content.get<std::uint64_t>();  // Where the offsets of groups are: all is read.
    const auto crc = footer.content.get<std::uint32_t>();
    if (begin == 0) return false;
    if (begin < data_begin || begin > footer_at) {
      throw core::InputError::expected(file.origin(0).place(footer_at), "where the summary is",
                                       std::to_string(begin));
    }
    const Bytes bytes = file.read(begin, footer_at + footer_length - begin);
    check_crc(std::span(bytes).first(bytes.size() - sizeof crc), crc,
              file.origin(0).place(begin) + " (summary)");
    ByteReader reader(std::span<const std::byte>(bytes).first(footer_at - begin),
                      file.origin(begin));
    return read_summary_records(reader);
  }

  bool read_summary_records(ByteReader& reader) {
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
    const bool all = promised ? entries.size() == *promised : any_chunk;
    if (!all) {
      forget();
      return false;
    }
    for (const auto& [offset, length] : metadata_at) {
      const Bytes bytes = file.read(offset, length);
      ByteReader one(bytes, file.origin(offset));
      Record record = next_record(one);
      if (record.opcode != Opcode::kMetadata) one.fail("the record Metadata", "another");
      add_metadata(record.content);
    }
    indexed = true;
    return true;
  }

  void forget() {
    schemas.clear();
    channels.clear();
    entries.clear();
    metadata.clear();
  }

  void add_schema(ByteReader& content) {
    const auto id = content.get<std::uint16_t>();
    Schema schema;
    schema.name = content.text();
    schema.encoding = content.text();
    schema.text = content.text();
    const auto [at, is_new] = schemas.try_emplace(id, schema);
    if (!is_new && at->second != schema) {
      content.fail("one schema with number " + std::to_string(id), "two");
    }
  }

  void add_channel(ByteReader& content) {
    const auto id = content.get<std::uint16_t>();
    ChannelRecord record;
    record.schema = content.get<std::uint16_t>();
    record.channel.topic = content.text();
    record.channel.message_encoding = content.text();
    record.channel.metadata = content.texts();
    const auto [at, is_new] = channels.try_emplace(id, record);
    if (!is_new &&
        (at->second.schema != record.schema || at->second.channel != record.channel)) {
      content.fail("one channel with number " + std::to_string(id), "two");
    }
  }

  void add_metadata(ByteReader& content) {
    Metadata found;
    found.name = content.text();
    found.values = content.texts();
    metadata.push_back(std::move(found));
  }

  void add_chunk_index(ByteReader& content) {
    content.get<std::uint64_t>();  // The span of its times: messages have theirs.
    content.get<std::uint64_t>();
    const auto chunk = content.get<std::uint64_t>();
    const auto length = content.get<std::uint64_t>();
    content.list();  // Where each channel's index is: they follow one another.
    const auto index_length = content.get<std::uint64_t>();
    if (chunk < data_begin || !file.holds(chunk, length) ||
        !file.holds(chunk + length, index_length)) {
      content.fail("a chunk and its index within the file",
                   std::to_string(chunk) + " + " + std::to_string(length) + " + " +
                       std::to_string(index_length));
    }
    if (!indexed_chunks.insert(chunk).second) {
      content.fail("each chunk once", "that at byte " + std::to_string(chunk) + " twice");
    }
    if (index_length == 0) {
      index_records(chunk, load_chunk(chunk));
      return;
    }
    const Bytes bytes = file.read(chunk + length, index_length);
    ByteReader reader(bytes, file.origin(chunk + length));
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

  /// Takes down what a chunk's records say.
  void index_records(std::uint64_t chunk, std::span<const std::byte> records) {
    ByteReader reader(records, {&file.name(), 0, chunk});
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

  /// The records of the chunk at that place, from the cache or the file; valid until the next
  /// call.
  std::span<const std::byte> load_chunk(std::uint64_t chunk) {
    const auto found = std::find_if(cache.begin(), cache.end(),
                                    [chunk](const auto& held) { return held.first == chunk; });
    if (found != cache.end()) {
      cache.splice(cache.begin(), cache, found);
      return cache.front().second;
    }
    cache.emplace_front(chunk, read_chunk(chunk));
    cached_bytes += cache.front().second.size();
    while (cached_bytes > kCacheBytes && cache.size() > 1) {
      cached_bytes -= cache.back().second.size();
      cache.pop_back();
    }
    return cache.front().second;
  }

  Bytes read_chunk(std::uint64_t chunk) {
    const Bytes head = file.read(chunk, kRecordHeadBytes);
    ByteReader reader(head, file.origin(chunk));
    if (reader.get<std::uint8_t>() != static_cast<std::uint8_t>(Opcode::kChunk)) {
      reader.fail("the record Chunk", "another");
    }
    const std::uint64_t begin = chunk + kRecordHeadBytes;
    const Bytes bytes = file.read(begin, reader.get<std::uint64_t>());
    ByteReader content(bytes, file.origin(begin));
    content.get<std::uint64_t>();
    content.get<std::uint64_t>();
    const auto size = content.get<std::uint64_t>();
    const auto crc = content.get<std::uint32_t>();
    const std::string compression = content.text();
    const auto stored_size = content.get<std::uint64_t>();
    const std::string place = file.origin(0).place(chunk) + " (chunk)";
    const std::uint64_t most = std::min(kMostChunkBytes, budget_bytes);
    if (size > most) {
      throw core::InputError::expected(
          place, "at most " + std::to_string(most) + " bytes, decompressed",
          std::to_string(size));
    }
    budget_bytes -= size;
    Bytes records = internal::decompress(content.take(stored_size), compression, size, place);
    check_crc(records, crc, place);
    return records;
  }

  /// Reads all records in order. What a missing end cut off is left out.
  void scan() {
    std::uint64_t at = data_begin;
    while (true) {
      if (!file.holds(at, kRecordHeadBytes)) return end_of_scan(at, "a record");
      const Bytes head = file.read(at, kRecordHeadBytes);
      ByteReader reader(head, file.origin(at));
      const auto opcode = static_cast<Opcode>(reader.get<std::uint8_t>());
      const auto length = reader.get<std::uint64_t>();
      const std::uint64_t begin = at + kRecordHeadBytes;
      if (opcode == Opcode::kDataEnd || opcode == Opcode::kFooter) {
        if (!whole) end_of_scan(at, "a summary and a footer");
        return;
      }
      if (opcode == Opcode{} || !file.holds(begin, length)) {
        return end_of_scan(at, "a whole record");
      }
      scan_record(opcode, at, begin, length);
      at = begin + length;
    }
  }

  void scan_record(Opcode opcode, std::uint64_t at, std::uint64_t begin,
                   std::uint64_t length) {
    if (opcode == Opcode::kChunk) return index_records(at, load_chunk(at));
    if (opcode == Opcode::kMessage) {
      const Bytes bytes = file.read(begin, std::min<std::uint64_t>(length, kMessageHeadBytes));
      ByteReader content(bytes, file.origin(begin));
      const MessageHead head_of = read_head(content);
      add_entry({head_of.log_time_ns, 0, at, head_of.channel});
      return;
    }
    if (opcode != Opcode::kSchema && opcode != Opcode::kChannel &&
        opcode != Opcode::kMetadata) {
      return;
    }
    const Bytes bytes = file.read(begin, length);
    ByteReader content(bytes, file.origin(begin));
    if (opcode == Opcode::kSchema) add_schema(content);
    if (opcode == Opcode::kChannel) add_channel(content);
    if (opcode == Opcode::kMetadata) add_metadata(content);
  }

  /// A file without its closing magic was cut short; in one that has it, records must end.
  void end_of_scan(std::uint64_t at, const std::string& expected) {
    const std::string place = file.origin(0).place(at);
    const std::string found = "the end of the file at byte " + std::to_string(file.size());
    if (whole) throw core::InputError::expected(place, expected, found);
    truncation = core::InputError::expected(place, expected, found).what();
  }

  void give(const Entry& entry, const std::function<void(const StoredMessage&)>& receive) {
    Bytes own;
    std::span<const std::byte> bytes;
    Origin origin = file.origin(entry.offset);
    if (entry.chunk != 0) {
      bytes = load_chunk(entry.chunk);
      if (entry.offset > bytes.size()) {
        throw core::InputError::expected(
            file.origin(0).place(entry.chunk) + " (chunk)",
            "messages within its " + std::to_string(bytes.size()) + " bytes",
            "one at " + std::to_string(entry.offset));
      }
      bytes = bytes.subspan(entry.offset);
      origin = {&file.name(), entry.offset, entry.chunk};
    } else {
      const Bytes head = file.read(entry.offset, kRecordHeadBytes);
      std::uint64_t length = 0;
      std::memcpy(&length, head.data() + 1, sizeof length);
      own = file.read(entry.offset, kRecordHeadBytes + length);
      bytes = own;
    }
    ByteReader reader(bytes, origin);
    Record record = next_record(reader);
    if (record.opcode != Opcode::kMessage) reader.fail("the record Message", "another");
    const MessageHead head = read_head(record.content);
    if (head.channel != entry.channel || head.log_time_ns != entry.log_time_ns) {
      reader.fail("the message that the index names", "another");
    }
    receive({&channels.at(head.channel).channel, head.sequence, head.log_time_ns,
             head.publish_time_ns, record.content.rest(), &file.name()});
  }

  RandomAccessFile file;
  std::string profile, library, truncation;
  std::uint64_t data_begin = 0;  ///< Behind the header.
  bool whole = false;            ///< The file ends as it should.
  bool indexed = false;
  std::map<std::uint16_t, Schema> schemas;
  std::map<std::uint16_t, ChannelRecord> channels;
  std::vector<Metadata> metadata;
  std::vector<Entry> entries;
  std::set<std::uint64_t> indexed_chunks;
  std::uint64_t budget_bytes = 0;                    ///< That may still be decompressed.
  std::list<std::pair<std::uint64_t, Bytes>> cache;  ///< The one used last comes first.
  std::size_t cached_bytes = 0;
};

Reader::Reader(const fs::path& file) : impl_(std::make_unique<Impl>(file)) {}

Reader::~Reader() = default;

const std::string& Reader::profile() const { return impl_->profile; }
const std::string& Reader::library() const { return impl_->library; }
bool Reader::has_index() const { return impl_->indexed; }
const std::string& Reader::truncation() const { return impl_->truncation; }
const std::vector<Metadata>& Reader::metadata() const { return impl_->metadata; }
std::uint64_t Reader::message_count() const { return impl_->entries.size(); }

std::vector<const Channel*> Reader::channels() const {
  std::vector<const Channel*> channels;
  for (const auto& [id, record] : impl_->channels) channels.push_back(&record.channel);
  return channels;
}

void Reader::read(const std::function<void(const StoredMessage&)>& receive,
                  std::span<const std::string> topics) {
  std::set<std::uint16_t> wanted;
  for (const auto& [id, record] : impl_->channels) {
    const bool named =
        std::find(topics.begin(), topics.end(), record.channel.topic) != topics.end();
    if (topics.empty() || named) wanted.insert(id);
  }
  impl_->begin_pass();
  for (const Entry& entry : impl_->entries) {
    if (wanted.contains(entry.channel)) impl_->give(entry, receive);
  }
}

}  // namespace segsim::ros::mcap
