#pragma once

/// @file
/// Another program that takes the part of a policy or of a detector (docs/connect.md), as a
/// spec names it:
///
///     policy: {type: process, command: [python3, "${spec}/my_policy.py"]}
///     detector: {type: process, socket: /run/my_detector.sock, answer_s: 2}

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/config.h"

namespace segsim::core {

struct PeerCommand {
  std::vector<std::string> command;  ///< Program and arguments; empty: it listens already.
  std::filesystem::path socket;      ///< Where it listens; empty: `command` is started.
  double start_s = 60.0;             ///< Wall time until it is ready.
  double answer_s = 10.0;            ///< Wall time for any other answer.

  bool operator==(const PeerCommand&) const = default;
  /// For messages: the command, or the socket.
  [[nodiscard]] std::string in_words() const;
};

/// Reads `command` or `socket`, `start_s` and `answer_s` of a map.
/// @param expand  A path of a node, with the spec's variables replaced.
/// @throws InputError with file, line and key.
[[nodiscard]] PeerCommand read_peer_command(
    const ConfigNode& map,
    const std::function<std::filesystem::path(const ConfigNode&)>& expand);

}  // namespace segsim::core
