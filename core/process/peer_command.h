#pragma once

/// @file
/// Another program that takes the part of a policy or of a detector (docs/connect.md), as a
/// spec names it:
///
///     policy: {type: process, command: [python3, "${spec}/my_policy.py"]}
///     detector: {type: process, socket: /run/my_detector.sock, answer_s: 2}
///     policy: python:my_module:MyPolicy

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/config.h"

namespace segsim::core {

struct PeerCommand {
  std::vector<std::string> command;  ///< Program and arguments; empty: it listens already.
  std::filesystem::path socket;      ///< Where it listens; empty: `command` is started.
  std::string python;                ///< Instead of both: "module:Class".
  std::filesystem::path folder;      ///< Of that module: the spec's.
  double start_s = 60.0;             ///< Wall time until it is ready.
  double answer_s = 10.0;            ///< Wall time for any other answer.

  bool operator==(const PeerCommand&) const = default;
  /// For messages: the command, the socket, or "python:module:Class".
  [[nodiscard]] std::string in_words() const;
};

/// Reads `command`, `socket` or `python`, and `start_s` and `answer_s`, of a map.
/// @param expand  A path of a node, with the spec's variables replaced.
/// @throws InputError with file, line and key.
[[nodiscard]] PeerCommand read_peer_command(
    const ConfigNode& map,
    const std::function<std::filesystem::path(const ConfigNode&)>& expand);

/// The map that "python:module:Class" is short for, as a node of its own.
/// @return  None if the node is no such text.
[[nodiscard]] std::optional<ConfigNode> python_peer_map(const ConfigNode& node);

}  // namespace segsim::core
