#pragma once

/// @file
/// The other side: a C++ program becomes a policy or a detector for `type: process`. See
/// examples/peer_policy.cpp.

#include <functional>
#include <memory>

#include "core/stages.h"
#include "peers/channel.h"
#include "peers/episode_start.h"

namespace segsim::peers {

using MakeServedPolicy =
    std::function<std::unique_ptr<core::Policy>(const EpisodeStart& start)>;

/// Answers until the other side closes. @param make  Makes the policy of each episode, which
/// is then reset with its goal and seed.
/// @throws core::InputError if the other side does not speak the protocol. What the policy
/// throws is told to it, and fails the trial.
void serve_policy(Channel& channel, const MakeServedPolicy& make);
void serve_detector(Channel& channel, core::Detector& detector);

/// Standard input and output. What the program prints from now on goes to standard error.
[[nodiscard]] Channel standard_streams();

}  // namespace segsim::peers
