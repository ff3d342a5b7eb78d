#pragma once

/// @file
/// A running program and the messages to it.

#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>
#include <sys/wait.h>

#include "core/process/peer_command.h"
#include "peers/channel.h"
#include "peers/internal/messages.h"
#include "peers/shared_images.h"

namespace segsim::peers::internal {

/// A program in a process group of its own, so that Ctrl-C is for the one that started it.
class ChildProcess {
 public:
  /// Starts it with `end` as its standard input and output.
  /// @throws core::InputError if there is no such program.
  ChildProcess(const std::vector<std::string>& command, const OwnedFd& end);
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;
  /// Waits for its end a second, then kills it and what it started.
  ~ChildProcess();

  /// "ended with exit code 1", "was ended by signal 11"; empty while it runs. Waits a moment
  /// for one that is about to end.
  [[nodiscard]] std::string end_in_words();

 private:
  bool wait_until(Channel::Clock::time_point deadline);

  pid_t pid_ = -1;
  std::optional<siginfo_t> end_;
};

class Connection {
 public:
  /// Starts `command`, or connects to its socket, and waits until it is ready.
  Connection(const core::PeerCommand& command, const std::string& role,
             const std::vector<std::string>& goals);

  /// What it said when it was ready.
  [[nodiscard]] const Json& ready() const { return ready_; }
  /// Sends `message` and returns the answer, which is of the type `expected`.
  [[nodiscard]] Json ask(const Json& message, const char* expected, double within_s);
  /// For messages about an answer.
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] SharedImages& images() { return images_; }

 private:
  [[nodiscard]] std::string end_in_words();

  std::string name_;
  std::optional<ChildProcess> child_;  // Ends after its input, which `channel_` is.
  std::optional<Channel> channel_;
  SharedImages images_;
  Json ready_;
};

}  // namespace segsim::peers::internal
