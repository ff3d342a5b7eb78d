#pragma once

/// @file
/// Classes of Python modules as policies and detectors (python/fastsegsim/peer.py).

#include "core/process/peer_command.h"

namespace segsim::experiments::trials {

/// A command that names a class, as one that starts Python with it; any other as it is.
/// @throws core::InputError if the module that serves classes is not there.
[[nodiscard]] core::PeerCommand runnable(core::PeerCommand command);

}  // namespace segsim::experiments::trials
