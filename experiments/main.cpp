// `segsim-main`: all of `segsim`. Users start the launcher (experiments/launcher.cpp).
#include "experiments/commands/commands.h"
#include "experiments/program.h"

namespace {

void add_commands(CLI::App& app) {
  using namespace segsim::experiments;  // NOLINT(google-build-using-namespace): one of each
  add_run_command(app);
  add_table_command(app);
  add_capture_command(app);
  add_reconstruct_command(app);
  add_scene_command(app);
  add_render_command(app);
  add_label_command(app);
  add_detector_command(app);
  add_masks_command(app);
  add_gazebo_command(app);
  add_bench_command(app);
  add_budget_command(app);
  add_replay_command(app);
  add_episodes_command(app);
  add_explain_command(app);
  add_compare_command(app);
  add_doctor_command(app);
  add_plan_command(app);
  add_export_command(app);
  add_report_command(app);
  add_serve_command(app);
  add_sensors_command(app);
  add_robots_command(app);
  add_trial_command(app);
  add_video_command(app);
}

}  // namespace

int main(int argc, char** argv) {
  return segsim::experiments::run_program(argc, argv, add_commands);
}
