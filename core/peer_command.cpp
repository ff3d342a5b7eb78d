#include "core/peer_command.h"

namespace segsim::core {
namespace {

constexpr double kLongest_s = 3600.0;

double seconds_or(const ConfigNode& map, const std::string& key, double fallback_s) {
  const double value_s = map.number_or(key, fallback_s);
  if (!(value_s > 0.0 && value_s <= kLongest_s)) {
    map.child(key).fail("seconds in (0, 3600]", map.text(key));
  }
  return value_s;
}

}  // namespace

std::string PeerCommand::in_words() const {
  if (command.empty()) return socket.string();
  std::string words;
  for (const std::string& word : command) words += (words.empty() ? "" : " ") + word;
  return words;
}

PeerCommand read_peer_command(
    const ConfigNode& map,
    const std::function<std::filesystem::path(const ConfigNode&)>& expand) {
  PeerCommand peer;
  if (map.has("command") == map.has("socket")) {
    map.fail("either `command: [PROGRAM, ARGUMENT...]` or `socket: PATH`",
             map.has("command") ? "both" : "none");
  }
  if (map.has("socket")) {
    peer.socket = expand(map.child("socket"));
  } else {
    for (const ConfigNode& word : map.child("command").as_list()) {
      const std::string text = word.as_text();
      // Only what names a variable is a path for certain.
      peer.command.push_back(text.find("${") == std::string::npos ? text
                                                                  : expand(word).string());
    }
    if (peer.command.empty() || peer.command.front().empty()) {
      map.child("command").fail("a program and its arguments", "none");
    }
  }
  peer.start_s = seconds_or(map, "start_s", peer.start_s);
  peer.answer_s = seconds_or(map, "answer_s", peer.answer_s);
  return peer;
}

}  // namespace segsim::core
