#include "ros/mcap/mcap_writer.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include <zlib.h>

#include "core/check.h"
#include "core/version.h"
#include "ros/mcap/internal/compression.h"
#include "ros/mcap/internal/records.h"

namespace segsim::ros::mcap {
namespace {

using internal::Bytes;
using internal::ListScope;
using internal::Opcode;
using internal::put;
using internal::put_bytes;
using internal::put_text;
using internal::RecordScope;

std::uint32_t crc_of(std::span<const std::byte> bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(
      ::crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

struct TimeSpan {
  std::uint64_t first_ns = std::numeric_limits<std::uint64_t>::max(), last_ns = 0;
  void add(std::uint64_t time_ns) {
    first_ns = std::min(first_ns, time_ns);
    last_ns = std::max(last_ns, time_ns);
  }
  /// The format's zeros if there is no message.
  void put_into(Bytes& bytes) const {
    put(bytes, first_ns > last_ns ? std::uint64_t{0} : first_ns);
    put(bytes, last_ns);
  }
};

struct ChunkEntry {
  TimeSpan times;
  std::uint64_t offset = 0, length = 0;  ///< Of the record, with its head.
  std::map<std::uint16_t, std::uint64_t> index_offsets;
  std::uint64_t index_length = 0;
  std::uint64_t compressed_size = 0, uncompressed_size = 0;
};

struct MetadataEntry {
  std::uint64_t offset = 0, length = 0;
  std::string name;
};

}  // namespace

struct Writer::Impl {
  Impl(std::ostream& stream, const WriterOptions& chosen)
      : out(stream), options(chosen), compressor(chosen.compression) {
    chunk.reserve(options.chunk_bytes + (options.chunk_bytes >> 2U));
    Bytes head;
    put_bytes(head, internal::kMagic, internal::kMagicBytes);
    {
      const RecordScope record(head, Opcode::kHeader);
      put_text(head, options.profile);
      put_text(head, std::string("segsim ") + core::version());
    }
    emit(head);
  }

  /// Every byte goes through here: position and checksum of the data section go with it.
  void emit(std::span<const std::byte> bytes) { emit(bytes, crc_of(bytes)); }
  void emit(std::span<const std::byte> bytes, std::uint32_t crc) {
    out.write(reinterpret_cast<const char*>(bytes.data()),
              static_cast<std::streamsize>(bytes.size()));
    position += bytes.size();
    data_crc = static_cast<std::uint32_t>(
        ::crc32_combine(data_crc, crc, static_cast<z_off_t>(bytes.size())));
  }

  void put_schema(Bytes& bytes, std::uint16_t id) const {
    const Schema& schema = schemas.at(id - 1U);
    const RecordScope record(bytes, Opcode::kSchema);
    put(bytes, id);
    put_text(bytes, schema.name);
    put_text(bytes, schema.encoding);
    put_text(bytes, schema.text);
  }
  void put_channel(Bytes& bytes, std::uint16_t id) const {
    const Channel& channel = channels.at(id);
    const RecordScope record(bytes, Opcode::kChannel);
    put(bytes, id);
    put(bytes, schema_of.at(id));
    put_text(bytes, channel.topic);
    put_text(bytes, channel.message_encoding);
    internal::put_texts(bytes, channel.metadata);
  }

  void flush_chunk() {
    if (chunk.empty()) return;
    const std::uint32_t crc = crc_of(chunk);
    const std::span<const std::byte> stored = compressor.compress(chunk);
    const std::string name = internal::name_in_file(options.compression);
    ChunkEntry entry;
    entry.times = chunk_times;
    entry.offset = position;
    entry.uncompressed_size = chunk.size();
    entry.compressed_size = stored.size();

    scratch.clear();
    put(scratch, static_cast<std::uint8_t>(Opcode::kChunk));
    put(scratch, std::uint64_t{8 + 8 + 8 + 4 + 4 + name.size() + 8 + stored.size()});
    chunk_times.put_into(scratch);
    put(scratch, std::uint64_t{chunk.size()});
    put(scratch, crc);
    put_text(scratch, name);
    put(scratch, std::uint64_t{stored.size()});
    emit(scratch);
    if (options.compression == Compression::kNone) {
      emit(stored, crc);
    } else {
      emit(stored);
    }
    entry.length = position - entry.offset;

    scratch.clear();
    for (auto& [channel, messages] : chunk_messages) {
      entry.index_offsets[channel] = position + scratch.size();
      const RecordScope record(scratch, Opcode::kMessageIndex);
      put(scratch, channel);
      const ListScope list(scratch);
      for (const auto& [time_ns, offset] : messages) {
        put(scratch, time_ns);
        put(scratch, offset);
      }
    }
    entry.index_length = scratch.size();
    emit(scratch);
    chunks.push_back(std::move(entry));
    chunk.clear();
    chunk_messages.clear();
    chunk_times = {};
  }

  void put_statistics(Bytes& bytes) const {
    std::uint64_t messages = 0;
    for (const std::uint32_t count : counts) messages += count;
    const RecordScope record(bytes, Opcode::kStatistics);
    put(bytes, messages);
    put(bytes, static_cast<std::uint16_t>(schemas.size()));
    put(bytes, static_cast<std::uint32_t>(channels.size()));
    put(bytes, std::uint32_t{0});  // Attachments.
    put(bytes, static_cast<std::uint32_t>(metadata.size()));
    put(bytes, static_cast<std::uint32_t>(chunks.size()));
    times.put_into(bytes);
    const ListScope list(bytes);
    for (std::size_t id = 0; id < counts.size(); ++id) {
      if (counts[id] == 0) continue;
      put(bytes, static_cast<std::uint16_t>(id));
      put(bytes, std::uint64_t{counts[id]});
    }
  }

  static void put_chunk_index(Bytes& bytes, const ChunkEntry& entry, const std::string& name) {
    const RecordScope record(bytes, Opcode::kChunkIndex);
    entry.times.put_into(bytes);
    put(bytes, entry.offset);
    put(bytes, entry.length);
    {
      const ListScope list(bytes);
      for (const auto& [channel, offset] : entry.index_offsets) {
        put(bytes, channel);
        put(bytes, offset);
      }
    }
    put(bytes, entry.index_length);
    put_text(bytes, name);
    put(bytes, entry.compressed_size);
    put(bytes, entry.uncompressed_size);
  }

  /// The summary and where its groups are; positions are those in the file.
  Bytes summary_bytes() const {
    Bytes bytes, offsets;
    const auto group = [&](Opcode opcode, auto&& write) {
      const std::uint64_t begin = position + bytes.size();
      write();
      const std::uint64_t length = position + bytes.size() - begin;
      if (length == 0) return;
      const RecordScope record(offsets, Opcode::kSummaryOffset);
      put(offsets, static_cast<std::uint8_t>(opcode));
      put(offsets, begin);
      put(offsets, length);
    };
    group(Opcode::kSchema, [&] {
      for (std::size_t k = 0; k < schemas.size(); ++k) {
        put_schema(bytes, static_cast<std::uint16_t>(k + 1));
      }
    });
    group(Opcode::kChannel, [&] {
      for (std::size_t k = 0; k < channels.size(); ++k) {
        put_channel(bytes, static_cast<std::uint16_t>(k));
      }
    });
    group(Opcode::kStatistics, [&] { put_statistics(bytes); });
    group(Opcode::kChunkIndex, [&] {
      const std::string name = internal::name_in_file(options.compression);
      for (const ChunkEntry& entry : chunks) put_chunk_index(bytes, entry, name);
    });
    group(Opcode::kMetadataIndex, [&] {
      for (const MetadataEntry& entry : metadata) {
        const RecordScope record(bytes, Opcode::kMetadataIndex);
        put(bytes, entry.offset);
        put(bytes, entry.length);
        put_text(bytes, entry.name);
      }
    });
    const std::uint64_t offsets_at = position + bytes.size();
    put_bytes(bytes, offsets.data(), offsets.size());
    // The checksum covers the footer as far as itself.
    put(bytes, static_cast<std::uint8_t>(Opcode::kFooter));
    put(bytes, std::uint64_t{internal::kFooterBytes});
    put(bytes, position);
    put(bytes, offsets_at);
    put(bytes, crc_of(bytes));
    put_bytes(bytes, internal::kMagic, internal::kMagicBytes);
    return bytes;
  }

  std::ostream& out;
  WriterOptions options;
  internal::Compressor compressor;
  std::uint64_t position = 0;
  std::uint32_t data_crc = 0;
  bool closed = false;

  std::vector<Schema> schemas;           ///< Number k + 1: 0 means none.
  std::vector<Channel> channels;         ///< By number.
  std::vector<std::uint16_t> schema_of;  ///< Of each channel.
  std::vector<bool> announced;           ///< Whether a chunk has the channel's record.
  std::vector<std::uint32_t> counts;     ///< Messages of each channel.
  TimeSpan times;

  Bytes chunk, scratch;
  TimeSpan chunk_times;
  /// Channel -> time and offset in the chunk.
  std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> chunk_messages;
  std::vector<ChunkEntry> chunks;
  std::vector<MetadataEntry> metadata;
};

Writer::Writer(std::ostream& out, const WriterOptions& options)
    : impl_(std::make_unique<Impl>(out, options)) {}

Writer::~Writer() = default;

std::uint16_t Writer::add_channel(const Channel& channel) {
  Impl& to = *impl_;
  constexpr std::size_t kMost = std::numeric_limits<std::uint16_t>::max();
  SEGSIM_CHECK(to.channels.size() < kMost, "too many channels");
  const auto found = std::find(to.schemas.begin(), to.schemas.end(), channel.schema);
  to.schema_of.push_back(static_cast<std::uint16_t>(found - to.schemas.begin() + 1));
  if (found == to.schemas.end()) to.schemas.push_back(channel.schema);
  to.channels.push_back(channel);
  to.announced.push_back(false);
  to.counts.push_back(0);
  return static_cast<std::uint16_t>(to.channels.size() - 1);
}

void Writer::write(std::uint16_t channel, std::uint64_t log_time_ns,
                   std::uint64_t publish_time_ns, std::span<const std::byte> data) {
  Impl& to = *impl_;
  SEGSIM_CHECK(!to.closed && channel < to.channels.size(), std::to_string(channel));
  if (!to.announced[channel]) {
    to.put_schema(to.chunk, to.schema_of[channel]);
    to.put_channel(to.chunk, channel);
    to.announced[channel] = true;
  }
  to.chunk_messages[channel].emplace_back(log_time_ns, to.chunk.size());
  put(to.chunk, static_cast<std::uint8_t>(Opcode::kMessage));
  put(to.chunk, std::uint64_t{internal::kMessageHeadBytes + data.size()});
  put(to.chunk, channel);
  put(to.chunk, to.counts[channel]++);
  put(to.chunk, log_time_ns);
  put(to.chunk, publish_time_ns);
  put_bytes(to.chunk, data.data(), data.size());
  to.chunk_times.add(log_time_ns);
  to.times.add(log_time_ns);
  if (to.chunk.size() >= to.options.chunk_bytes) to.flush_chunk();
}

void Writer::add_metadata(const Metadata& metadata) {
  Impl& to = *impl_;
  SEGSIM_CHECK(!to.closed, metadata.name);
  Bytes bytes;
  {
    const RecordScope record(bytes, Opcode::kMetadata);
    put_text(bytes, metadata.name);
    internal::put_texts(bytes, metadata.values);
  }
  to.metadata.push_back({to.position, bytes.size(), metadata.name});
  to.emit(bytes);
}

void Writer::close() {
  Impl& to = *impl_;
  SEGSIM_CHECK(!to.closed, "closed before");
  to.flush_chunk();
  Bytes end;
  {
    const RecordScope record(end, Opcode::kDataEnd);
    put(end, to.data_crc);
  }
  to.emit(end);
  to.emit(to.summary_bytes());
  to.closed = true;
}

}  // namespace segsim::ros::mcap
