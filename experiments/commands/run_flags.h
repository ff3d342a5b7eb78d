#pragma once

/// @file
/// Flags of commands that run an experiment, and what they print: `segsim run` and `segsim
/// suite run`.

#include <string>

#include "experiments/runs/run.h"

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class App;
}

namespace segsim::experiments::commands {

struct RunFlags {
  std::string shard;
  std::string backend;  ///< Empty: the spec's.
  runs::RunOptions options;
};

/// @param flags  Outlives the command.
void add_run_flags(CLI::App& command, RunFlags& flags);

/// The text of a spec with the backend that the flags name, if they do.
[[nodiscard]] std::string with_flags(std::string spec_text, const RunFlags& flags);

/// Runs it and prints table, digests, times. @return  How it ended: check_end() throws that.
runs::RunReport run_and_print(const specs::ExperimentSpec& spec, const RunFlags& flags);

/// @throws what its exit code stands for, if the run did not end well.
void check_end(const runs::RunReport& report);

}  // namespace segsim::experiments::commands
