#include "core/process/peer_command.h"

#include <algorithm>
#include <array>

namespace segsim::core {
namespace {

constexpr const char* kPython = "python:";

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
  if (!python.empty()) return kPython + python;
  if (command.empty()) return socket.string();
  std::string words;
  for (const std::string& word : command) words += (words.empty() ? "" : " ") + word;
  return words;
}

PeerCommand read_peer_command(
    const ConfigNode& map,
    const std::function<std::filesystem::path(const ConfigNode&)>& expand) {
  PeerCommand peer;
  constexpr std::array kWays{"command", "socket", "python"};
  const auto ways =
      std::count_if(kWays.begin(), kWays.end(), [&](const char* way) { return map.has(way); });
  if (ways != 1) {
    map.fail(
        "one of `command: [PROGRAM, ARGUMENT...]`, `socket: PATH` and "
        "`python: MODULE:CLASS`",
        ways == 0 ? "none" : "several");
  }
  if (map.has("python")) {
    peer.python = map.text("python");
    if (std::count(peer.python.begin(), peer.python.end(), ':') != 1) {
      map.child("python").fail("MODULE:CLASS", "\"" + peer.python + "\"");
    }
    peer.folder = expand(ConfigNode::parse("${spec}", map.where()));
  } else if (map.has("socket")) {
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

std::optional<ConfigNode> python_peer_map(const ConfigNode& node) {
  if (!node.is_scalar() || !node.as_text().starts_with(kPython)) return std::nullopt;
  const std::string name = node.as_text().substr(std::string(kPython).size());
  const bool plain = std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           c == '_' || c == '.' || c == ':';
  });
  if (!plain) node.fail("python:MODULE:CLASS", "\"" + node.as_text() + "\"");
  return ConfigNode::parse("{type: process, python: \"" + name + "\"}", node.where());
}

}  // namespace segsim::core
