#pragma once

/// @file
/// A program beside this one that decides or detects in its place, one message for one answer
/// (docs/connect.md has the protocol).

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/process/peer_command.h"
#include "core/stages.h"
#include "peers/episode_start.h"

namespace segsim::peers {

namespace internal {
class Connection;
}

/// A program that is asked, trial after trial; one for each thread that asks. It is started,
/// or connected to, when it is asked first, and again after it failed. It sees the end of its
/// input when this object goes; a program that was started here and has not ended a second
/// later is killed.
class Peer {
 public:
  /// @param role  "policy" or "detector".
  /// @param goals  What a detector is to look for, should it want to know.
  Peer(core::PeerCommand command, std::string role, std::vector<std::string> goals = {});
  ~Peer();
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  /// Starts it if it does not run. Everything else does so, too.
  /// @throws core::InputError if it cannot be started or does not say in time that it is
  /// ready; from then on in every call: if it has ended, says nothing in time or something
  /// wrong. The next call begins anew.
  void start();

  /// Of a detector that has started.
  [[nodiscard]] const std::vector<std::string>& class_names() const { return class_names_; }

  void reset(const EpisodeStart& start);
  /// @param view  Set to what the program tells of its plans.
  [[nodiscard]] core::Decision decide(const core::Observation& observation,
                                      std::span<const core::Detection> detections,
                                      core::PolicyView& view);
  [[nodiscard]] std::vector<core::Detection> detect(const core::Observation& observation);

 private:
  template <class Ask>
  auto guarded(const Ask& ask);

  core::PeerCommand command_;
  std::string role_;
  std::vector<std::string> goals_, class_names_;
  std::unique_ptr<internal::Connection> connection_;
};

/// The policy that `peer` is; episodes after one another. @param start  Of the trial; goal and
/// seed are set when the episode begins.
[[nodiscard]] std::unique_ptr<core::Policy> make_peer_policy(std::shared_ptr<Peer> peer,
                                                             EpisodeStart start);

/// The detector that `peer` is. Starts it.
/// @throws core::InputError as Peer::start().
[[nodiscard]] std::unique_ptr<core::Detector> make_peer_detector(std::shared_ptr<Peer> peer);

}  // namespace segsim::peers
