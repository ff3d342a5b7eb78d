#pragma once

/// @file
/// What an MCAP file says of itself, and where each of its messages is.

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "ros/mcap/internal/chunked_file.h"
#include "ros/mcap/mcap_format.h"

namespace segsim::ros::mcap::internal {

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
[[nodiscard]] MessageHead read_head(ByteReader& content);

struct ChannelRecord {
  std::uint16_t schema = 0;
  Channel channel;
};

/// Read from the summary at the file's end, or from all records where that says too little.
class FileIndex {
 public:
  /// @throws core::InputError naming the byte for a file that is damaged.
  explicit FileIndex(ChunkedFile& file);

  [[nodiscard]] const std::string& profile() const { return profile_; }
  [[nodiscard]] const std::string& library() const { return library_; }
  /// Where and how the file was cut short; empty: it was not.
  [[nodiscard]] const std::string& truncation() const { return truncation_; }
  [[nodiscard]] bool is_from_summary() const { return indexed_; }
  [[nodiscard]] const std::vector<Metadata>& metadata() const { return metadata_; }
  [[nodiscard]] const std::map<std::uint16_t, ChannelRecord>& channels() const {
    return channels_;
  }
  /// In order of time.
  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }

 private:
  void add_entry(const Entry& entry);
  void check_channel(std::uint16_t id) const;
  void read_start();
  [[nodiscard]] bool ends_with_magic();
  /// @return  Whether the file has an index of all its messages.
  bool read_summary();
  bool read_summary_records(ByteReader& reader);
  void forget();
  void add_schema(ByteReader& content);
  void add_channel(ByteReader& content);
  void add_metadata(ByteReader& content);
  void add_chunk_index(ByteReader& content);
  /// Takes down what a chunk's records say.
  void index_records(std::uint64_t chunk, std::span<const std::byte> records);
  /// Reads all records in order. What a missing end cut off is left out.
  void scan();
  void scan_record(Opcode opcode, std::uint64_t at, std::uint64_t begin, std::uint64_t length);
  /// A file without its closing magic was cut short; in one that has it, records must end.
  void end_of_scan(std::uint64_t at, const std::string& expected);

  ChunkedFile& file_;
  std::string profile_, library_, truncation_;
  std::uint64_t data_begin_ = 0;  ///< Behind the header.
  bool whole_ = false;            ///< The file ends as it should.
  bool indexed_ = false;
  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, ChannelRecord> channels_;
  std::vector<Metadata> metadata_;
  std::vector<Entry> entries_;
  std::set<std::uint64_t> indexed_chunks_;
};

}  // namespace segsim::ros::mcap::internal
