#include "experiments/program.h"

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/interrupted.h"
#include "core/process/process_memory.h"
#include "core/version.h"

namespace segsim::experiments {
namespace {

constexpr int kCheckFailedExit = 1;
constexpr int kInputErrorExit = 2;
constexpr int kInternalErrorExit = 3;
constexpr int kInterruptedExit = 4;

}  // namespace

int run_program(int argc, char** argv, void (*add_commands)(CLI::App& app)) {
  core::keep_freed_memory();
  std::signal(SIGXFSZ, SIG_IGN);  // A file at its limit is an error like a full disk.
  CLI::App app{
      "Fast-SegSim: does this perception change make the robot reach its goal more often?\n"
      "Closed-loop navigation trials in reconstructed scenes.",
      "segsim"};
  app.set_version_flag("--version", core::version());
  bool fast = false;  // The launcher takes it away.
  app.add_flag("--fast", fast,
               "Use whatever this processor has: quicker, and not comparable bit by bit with "
               "other machines (docs/reproducibility.md)");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 done, 1 an expectation failed, 2 bad input, too little memory or room on "
      "the disk,\n3 internal error, 4 stopped by a signal with trials left.\n"
      "Each subcommand has its own --help.");
  add_commands(app);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);  // Prints help or the message.
    return code == 0 ? 0 : kInputErrorExit;
  } catch (const core::InputError& error) {
    std::fprintf(stderr, "segsim: %s\n", error.what());
    return kInputErrorExit;
  } catch (const core::Interrupted& error) {
    std::fprintf(stderr, "segsim: %s\n", error.what());
    return kInterruptedExit;
  } catch (const core::CheckFailed& error) {
    std::fprintf(stderr, "segsim: %s\n", error.what());
    return kCheckFailedExit;
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "segsim: expected memory for the scene and its images, found none\n");
    return kInputErrorExit;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "segsim: internal error: %s\n", error.what());
    return kInternalErrorExit;
  }
  return 0;
}

}  // namespace segsim::experiments
