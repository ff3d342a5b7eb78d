// MCAP files (ros/mcap/mcap_reader.h). Checksums become 0, which means that there is none.
#include <cstring>
#include <sstream>

#include "ros/mcap/internal/records.h"
#include "ros/mcap/mcap_reader.h"
#include "ros/mcap/topic.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/std_msgs.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

using namespace ros::mcap;
using internal::Opcode;

/// Where the checksum is in the content of a record; beyond any content if there is none.
std::size_t checksum_at(Opcode opcode) {
  switch (opcode) {
    case Opcode::kChunk:
      return 24;
    case Opcode::kFooter:
      return 16;
    case Opcode::kDataEnd:
      return 0;
    default:
      return std::string::npos;
  }
}

std::string without_checksums(std::string bytes) {
  for (std::size_t at = internal::kMagicBytes;
       bytes.size() > at && bytes.size() - at >= internal::kRecordHeadBytes;) {
    std::uint64_t length = 0;
    std::memcpy(&length, bytes.data() + at + 1, sizeof length);
    const std::size_t content = at + internal::kRecordHeadBytes;
    if (length > bytes.size() - content) break;
    const std::size_t checksum = checksum_at(static_cast<Opcode>(bytes[at]));
    if (checksum < length && length - checksum >= 4) {
      std::memset(bytes.data() + content + checksum, 0, 4);
    }
    at = content + length;
  }
  return bytes;
}

}  // namespace

void parse(const std::string& bytes) {
  Reader reader(in_file(without_checksums(bytes), "input.mcap"));
  (void)reader.channels();
  reader.read([](const StoredMessage& message) {
    if (message.channel->topic == "/text") (void)decode<ros::std_msgs::String>(message);
  });
}

std::vector<std::string> seeds() {
  std::vector<std::string> all;
  for (const auto compression : {Compression::kNone, Compression::kLz4, Compression::kZstd}) {
    std::ostringstream out;
    Writer writer(out, {compression, 100, "ros2"});
    TopicWriter<ros::std_msgs::String> text(writer, "/text");
    TopicWriter<ros::std_msgs::Header> header(writer, "/header", {.transient_local = true});
    for (std::uint64_t k = 0; k < 3; ++k) {
      text.write(k, {"message " + std::string(20, 'x')});
      header.write(k, {{1, 7U}, "frame"});
    }
    writer.add_metadata({"segsim", {{"scene", "flat"}}});
    writer.close();
    all.push_back(out.str());
  }
  return all;
}

}  // namespace segsim::fuzz
