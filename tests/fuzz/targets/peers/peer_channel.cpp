// What a served policy receives: lines of JSON become messages with their lengths, and input
// that begins with '!' is sent as it is (peers/serve.h, peers/channel.h).
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <memory>

#include "core/error.h"
#include "peers/internal/messages.h"
#include "peers/serve.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/peers/summing_stages.h"

namespace segsim::fuzz {
namespace {

constexpr std::size_t kMost = 60000;  // What a socket takes before somebody reads.

std::string framed(const std::string& lines) {
  std::string bytes;
  std::size_t begin = 0;
  while (begin < lines.size()) {
    const std::size_t end = std::min(lines.find('\n', begin), lines.size());
    const auto length = static_cast<std::uint32_t>(end - begin);
    bytes.append(reinterpret_cast<const char*>(&length), sizeof length);
    bytes.append(lines, begin, length);
    begin = end + 1;
  }
  return bytes;
}

}  // namespace

void parse(const std::string& bytes) {
  const std::string sent = bytes.starts_with('!') ? bytes.substr(1) : framed(bytes);
  if (sent.size() > kMost) throw core::InputError("longer than the socket takes");
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0) std::abort();
  const peers::OwnedFd other(ends[0]);
  peers::Channel channel{peers::OwnedFd(ends[1]), "the simulator"};
  if (::send(ends[0], sent.data(), sent.size(), MSG_NOSIGNAL) < 0) std::abort();
  ::shutdown(ends[0], SHUT_WR);
  peers::serve_policy(channel, [](const peers::EpisodeStart&) {
    return std::make_unique<tests::SummingPolicy>();
  });
}

std::vector<std::string> seeds() {
  using namespace peers::internal;
  const Json hello = {{"type", "hello"}, {"schema", kSchema}, {"role", "policy"}};
  peers::EpisodeStart start;
  start.goal = {"couch", 1, "a red couch"};
  start.class_names = {"chair", "couch"};
  Json reset = to_json(start);
  reset["type"] = "reset";
  core::Observation seen;
  seen.intrinsics = core::CameraIntrinsics::from_fov(4, 3, 1.2);
  Json decide = to_json(seen, {});
  decide["type"] = "decide";
  decide["detections"] =
      to_json(std::vector<core::Detection>{{1, 0.9F, {1.0F, 2.0F, 3.0F, 4.0F}}});
  return {hello.dump() + "\n" + reset.dump() + "\n" + decide.dump() + "\n" + decide.dump()};
}

}  // namespace segsim::fuzz
