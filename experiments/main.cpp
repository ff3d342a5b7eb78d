#include <csignal>
#include <cstdio>
#include <exception>
#include <new>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/interrupted.h"
#include "core/process_memory.h"
#include "core/version.h"
#include "experiments/commands/commands.h"

namespace {

constexpr int kCheckFailedExit = 1;
constexpr int kInputErrorExit = 2;
constexpr int kInternalErrorExit = 3;
constexpr int kInterruptedExit = 4;

}  // namespace

int main(int argc, char** argv) {
  using namespace segsim;  // NOLINT(google-build-using-namespace): main wires everything

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
  experiments::add_run_command(app);
  experiments::add_table_command(app);
  experiments::add_capture_command(app);
  experiments::add_reconstruct_command(app);
  experiments::add_scene_command(app);
  experiments::add_render_command(app);
  experiments::add_label_command(app);
  experiments::add_detector_command(app);
  experiments::add_masks_command(app);
  experiments::add_gazebo_command(app);
  experiments::add_bench_command(app);
  experiments::add_budget_command(app);
  experiments::add_replay_command(app);
  experiments::add_episodes_command(app);
  experiments::add_explain_command(app);
  experiments::add_compare_command(app);
  experiments::add_doctor_command(app);
  experiments::add_plan_command(app);
  experiments::add_export_command(app);
  experiments::add_report_command(app);
  experiments::add_serve_command(app);
  experiments::add_sensors_command(app);
  experiments::add_trial_command(app);
  experiments::add_video_command(app);

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
