// `segsim-main`: all of `segsim`. Users start the launcher (experiments/launcher.cpp).
#include "experiments/commands/bridges/bridge_commands.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/commands/scene/scene_commands.h"
#include "experiments/program.h"

namespace {

namespace commands = segsim::experiments::commands;

void add_commands(CLI::App& app) {
  commands::add_run_command(app);
  commands::add_table_command(app);
  commands::add_suite_command(app);
  commands::add_capture_command(app);
  commands::add_reconstruct_command(app);
  commands::scene::add_scene_command(app);
  commands::add_render_command(app);
  commands::detectors::add_label_command(app);
  commands::detectors::add_detector_command(app);
  commands::detectors::add_masks_command(app);
  commands::detectors::add_evaluate_command(app);
  commands::bridges::add_gazebo_command(app);
  commands::add_bench_command(app);
  commands::add_budget_command(app);
  commands::add_replay_command(app);
  commands::add_episodes_command(app);
  commands::add_explain_command(app);
  commands::light::add_compare_command(app);
  commands::add_doctor_command(app);
  commands::light::add_plan_command(app);
  commands::light::add_export_command(app);
  commands::add_report_command(app);
  commands::add_serve_command(app);
  commands::add_sensors_command(app);
  commands::light::add_robots_command(app);
  commands::add_trial_command(app);
  commands::add_video_command(app);
  commands::add_record_command(app);
  commands::bridges::add_ros_command(app);
}

}  // namespace

int main(int argc, char** argv) {
  return segsim::experiments::run_program(argc, argv, add_commands);
}
