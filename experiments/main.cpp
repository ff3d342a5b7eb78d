// `segsim-main`: all of `segsim`. Users start the launcher (experiments/launcher.cpp).
#include "experiments/commands/commands.h"
#include "experiments/program.h"

namespace {

void add_commands(CLI::App& app) {
  using namespace segsim::experiments;  // NOLINT(google-build-using-namespace): one of each
  segsim::experiments::commands::add_run_command(app);
  segsim::experiments::commands::add_table_command(app);
  segsim::experiments::commands::add_capture_command(app);
  segsim::experiments::commands::add_reconstruct_command(app);
  segsim::experiments::commands::add_scene_command(app);
  segsim::experiments::commands::add_render_command(app);
  segsim::experiments::commands::add_label_command(app);
  segsim::experiments::commands::add_detector_command(app);
  segsim::experiments::commands::add_masks_command(app);
  segsim::experiments::commands::add_gazebo_command(app);
  segsim::experiments::commands::add_bench_command(app);
  segsim::experiments::commands::add_budget_command(app);
  segsim::experiments::commands::add_replay_command(app);
  segsim::experiments::commands::add_episodes_command(app);
  segsim::experiments::commands::add_explain_command(app);
  segsim::experiments::commands::add_compare_command(app);
  segsim::experiments::commands::add_doctor_command(app);
  segsim::experiments::commands::add_plan_command(app);
  segsim::experiments::commands::add_export_command(app);
  segsim::experiments::commands::add_report_command(app);
  segsim::experiments::commands::add_serve_command(app);
  segsim::experiments::commands::add_sensors_command(app);
  segsim::experiments::commands::add_robots_command(app);
  segsim::experiments::commands::add_trial_command(app);
  segsim::experiments::commands::add_video_command(app);
}

}  // namespace

int main(int argc, char** argv) {
  return segsim::experiments::run_program(argc, argv, add_commands);
}
