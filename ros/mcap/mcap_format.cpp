#include "ros/mcap/mcap_format.h"

namespace segsim::ros::mcap {

const char* to_string(Compression compression) {
  switch (compression) {
    case Compression::kLz4:
      return "lz4";
    case Compression::kZstd:
      return "zstd";
    case Compression::kNone:
      break;
  }
  return "none";
}

std::string StoredMessage::place() const {
  return *file + ": message on " + channel->topic + " at " + std::to_string(log_time_ns) +
         " ns";
}

}  // namespace segsim::ros::mcap
