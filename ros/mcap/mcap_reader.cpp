#include "ros/mcap/mcap_reader.h"

#include <algorithm>
#include <cstring>
#include <set>

#include "core/error.h"
#include "ros/mcap/internal/chunked_file.h"
#include "ros/mcap/internal/file_index.h"

namespace segsim::ros::mcap {

namespace fs = std::filesystem;
using internal::ByteReader;
using internal::Bytes;
using internal::Entry;
using internal::kRecordHeadBytes;
using internal::MessageHead;
using internal::next_record;
using internal::Opcode;
using internal::Origin;
using internal::Record;

struct Reader::Impl {
  explicit Impl(const fs::path& path) : file(path), index(file) {}

  void give(const Entry& entry, const std::function<void(const StoredMessage&)>& receive) {
    Bytes own;
    std::span<const std::byte> bytes;
    Origin origin = file.origin(entry.offset);
    if (entry.chunk != 0) {
      bytes = file.chunk(entry.chunk);
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
    const MessageHead head = internal::read_head(record.content);
    if (head.channel != entry.channel || head.log_time_ns != entry.log_time_ns) {
      reader.fail("the message that the index names", "another");
    }
    receive({&index.channels().at(head.channel).channel, head.sequence, head.log_time_ns,
             head.publish_time_ns, record.content.rest(), &file.name()});
  }

  internal::ChunkedFile file;
  internal::FileIndex index;
};

Reader::Reader(const fs::path& file) : impl_(std::make_unique<Impl>(file)) {}

Reader::~Reader() = default;

const std::string& Reader::profile() const { return impl_->index.profile(); }
const std::string& Reader::library() const { return impl_->index.library(); }
bool Reader::has_index() const { return impl_->index.is_from_summary(); }
const std::string& Reader::truncation() const { return impl_->index.truncation(); }
const std::vector<Metadata>& Reader::metadata() const { return impl_->index.metadata(); }
std::uint64_t Reader::message_count() const { return impl_->index.entries().size(); }

std::vector<const Channel*> Reader::channels() const {
  std::vector<const Channel*> channels;
  for (const auto& [id, record] : impl_->index.channels()) channels.push_back(&record.channel);
  return channels;
}

void Reader::read(const std::function<void(const StoredMessage&)>& receive,
                  std::span<const std::string> topics) {
  std::set<std::uint16_t> wanted;
  for (const auto& [id, record] : impl_->index.channels()) {
    const bool named =
        std::find(topics.begin(), topics.end(), record.channel.topic) != topics.end();
    if (topics.empty() || named) wanted.insert(id);
  }
  impl_->file.begin_pass();
  for (const Entry& entry : impl_->index.entries()) {
    if (wanted.contains(entry.channel)) impl_->give(entry, receive);
  }
}

}  // namespace segsim::ros::mcap
