#pragma once

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class App;
}

namespace segsim::experiments {

/// What segsim-main and segsim-light share: the flags of `segsim` itself, and the exit code of
/// every error.
/// @param add_commands  Adds the subcommands.
/// @return The exit code.
int run_program(int argc, char** argv, void (*add_commands)(CLI::App& app));

}  // namespace segsim::experiments
