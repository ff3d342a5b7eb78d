#pragma once

/// @file
/// Writes MCAP files (ros/mcap/mcap_format.h) in one pass, chunk by chunk, with every index
/// and checksum that the format knows: any reader can begin anywhere, and what is damaged
/// shows.

#include <cstdint>
#include <map>
#include <memory>
#include <ostream>
#include <span>
#include <string>

#include "ros/mcap/mcap_format.h"

namespace segsim::ros::mcap {

struct WriterOptions {
  Compression compression = Compression::kLz4;
  /// A chunk is closed when its records are so long [bytes]. Longer ones compress better, and
  /// more is lost when a file is cut short.
  std::size_t chunk_bytes = std::size_t{4} << 20U;
  std::string profile = "ros2";
};

class Writer {
 public:
  /// @param out  Must outlive the writer; nothing else is written there.
  explicit Writer(std::ostream& out, const WriterOptions& options = {});
  /// Without close() the file is not whole.
  ~Writer();
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  /// @return  The channel's number. Equal schemas are stored once.
  /// @throws core::ContractViolation beyond 65535 channels.
  [[nodiscard]] std::uint16_t add_channel(const Channel& channel);

  /// Times in ns; messages may come in any order, but readers like them in order of log time.
  void write(std::uint16_t channel, std::uint64_t log_time_ns, std::uint64_t publish_time_ns,
             std::span<const std::byte> data);

  void add_metadata(const Metadata& metadata);

  /// Writes what is left and the summary. Call once. Whether the stream took it all, its owner
  /// finds out.
  void close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::ros::mcap
