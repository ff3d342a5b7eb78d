// Writes and checks MCAP files for tests/ros/mcap_peer_test.py: of every message that this
// program knows one, filled with numbers and texts of its own, on the topic /<package>/<name>.
//
//   mcap_peer write FILE none|lz4|zstd    three messages a topic
//   mcap_peer check FILE                  whether FILE holds these; prints how many messages
//   mcap_peer types                       "<type> <hash>" of each
#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <tuple>
#include <utility>

#include "core/error.h"
#include "ros/mcap/topic.h"
#include "ros/messages/all_messages.h"
#include "tests/ros/filled_message.h"

namespace {

using namespace segsim;
namespace mcap = ros::mcap;

constexpr std::uint32_t kMessages = 3;
constexpr std::uint64_t kPeriod_ns = 100'000'000;

template <class... M>
void for_all(std::tuple<M...>* /*all*/, auto&& act) {
  (act(std::type_identity<M>{}), ...);
}

template <class M>
std::string topic_of() {
  return "/" + ros::short_name(M::kType);
}

void write(const std::string& file, const std::string& compression) {
  std::ofstream out(file, std::ios::binary);
  mcap::WriterOptions options;
  options.compression = compression == "lz4"    ? mcap::Compression::kLz4
                        : compression == "zstd" ? mcap::Compression::kZstd
                                                : mcap::Compression::kNone;
  options.chunk_bytes = 20'000;
  mcap::Writer writer(out, options);
  for_all(static_cast<ros::AllMessages*>(nullptr), [&]<class M>(std::type_identity<M>) {
    mcap::TopicWriter<M> topic(writer, topic_of<M>());
    for (std::uint32_t k = 0; k < kMessages; ++k) {
      topic.write(k * kPeriod_ns, ros::filled_message<M>(k));
    }
  });
  writer.add_metadata({"peer", {{"language", "C++"}}});
  writer.close();
}

int check(const std::string& file) {
  mcap::Reader reader(file);
  std::map<std::string, std::uint32_t> seen;
  int messages = 0;
  reader.read([&](const mcap::StoredMessage& message) {
    const std::string& topic = message.channel->topic;
    const std::uint32_t k = seen[topic]++;
    for_all(static_cast<ros::AllMessages*>(nullptr), [&]<class M>(std::type_identity<M>) {
      if (topic != topic_of<M>()) return;
      if (!(mcap::decode<M>(message) == ros::filled_message<M>(k))) {
        throw core::InputError::expected(message.place(), "the message that was written",
                                         "another");
      }
      ++messages;
    });
  });
  std::printf("%d messages, %s\n", messages, reader.has_index() ? "by index" : "scanned");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string action = argc > 1 ? argv[1] : "";
  try {
    if (action == "write" && argc == 4) {
      write(argv[2], argv[3]);
      return 0;
    }
    if (action == "check" && argc == 3) return check(argv[2]);
    if (action == "types") {
      for_all(static_cast<ros::AllMessages*>(nullptr), []<class M>(std::type_identity<M>) {
        std::printf("%s %s\n", ros::full_name(M::kType).c_str(),
                    ros::rihs01(ros::describe<M>()).c_str());
      });
      return 0;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  std::fprintf(stderr, "mcap_peer: expected write FILE COMPRESSION, check FILE or types\n");
  return 2;
}
