#include "experiments/trials/python_peer.h"

#include "core/error.h"
#include "core/input/regular_file.h"
#include "experiments/support/shipped_file.h"

namespace segsim::experiments::trials {

core::PeerCommand runnable(core::PeerCommand command) {
  if (command.python.empty()) return command;
  const std::filesystem::path server = support::find_shipped("python/fastsegsim/peer.py");
  if (!core::can_be_read(server)) {
    throw core::InputError::expected(server.string(),
                                     "the module that serves " + command.in_words(), "none");
  }
  command.command = {"python3", server.string(), "--path", command.folder.string(),
                     command.python};
  command.python.clear();
  return command;
}

}  // namespace segsim::experiments::trials
