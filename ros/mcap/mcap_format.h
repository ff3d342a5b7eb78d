#pragma once

/// @file
/// What an MCAP file holds (its specification: mcap.dev/spec, version 0): messages of
/// channels, each channel with the schema of its messages, in chunks that are compressed one
/// by one.
///
///     magic, Header
///     Chunk { Schema, Channel, Message ... }, MessageIndex of each channel in it, ...
///     Metadata ..., DataEnd
///     summary: Schema, Channel, Statistics, ChunkIndex, MetadataIndex, then SummaryOffset
///     Footer, magic

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "ros/message_type.h"

namespace segsim::ros::mcap {

enum class Compression : std::uint8_t { kNone, kLz4, kZstd };
/// "none", "lz4", "zstd".
[[nodiscard]] const char* to_string(Compression compression);

struct Schema {
  std::string name;      ///< "sensor_msgs/msg/Image"
  std::string encoding;  ///< "ros2msg"
  std::string text;
  bool operator==(const Schema&) const = default;
};

struct Channel {
  std::string topic;
  std::string message_encoding;  ///< "cdr"
  std::map<std::string, std::string> metadata;
  Schema schema;
  bool operator==(const Channel&) const = default;
};

/// Notes about the file as a whole.
struct Metadata {
  std::string name;
  std::map<std::string, std::string> values;
  bool operator==(const Metadata&) const = default;
};

/// A message as a reader gives it; borrowed for the call.
struct StoredMessage {
  const Channel* channel = nullptr;
  std::uint32_t sequence = 0;  ///< Counts the messages of the channel, if the writer did.
  std::uint64_t log_time_ns = 0, publish_time_ns = 0;
  std::span<const std::byte> data;
  const std::string* file = nullptr;

  /// For errors: file, topic and time.
  [[nodiscard]] std::string place() const;
};

}  // namespace segsim::ros::mcap
