#pragma once

/// @file
/// One function per subcommand of `segsim`: declares its flags and registers what runs when it
/// was named. Errors are thrown: core::InputError, core::CheckFailed; main() turns them into
/// exit codes. Those about scenes, detectors, Gazebo and ROS 2 lie in
/// folders of their own.

#include "experiments/commands/light/light_commands.h"

namespace segsim::experiments::commands {

void add_run_command(CLI::App& app);
void add_table_command(CLI::App& app);
/// `segsim suite run`, `table` and those of segsim-light.
void add_suite_command(CLI::App& app);
void add_capture_command(CLI::App& app);
void add_reconstruct_command(CLI::App& app);
void add_render_command(CLI::App& app);
void add_bench_command(CLI::App& app);
void add_budget_command(CLI::App& app);
void add_replay_command(CLI::App& app);
void add_episodes_command(CLI::App& app);
void add_explain_command(CLI::App& app);
void add_sensors_command(CLI::App& app);
/// `segsim trial check` and `segsim trial run`.
void add_trial_command(CLI::App& app);
/// `segsim table 1` and `2`, below `segsim table`.
void add_panoptic_table(CLI::App& table);
void add_ablation_table(CLI::App& table);
/// `segsim doctor`.
void add_doctor_command(CLI::App& app);
void add_report_command(CLI::App& app);
void add_serve_command(CLI::App& app);
void add_video_command(CLI::App& app);
void add_record_command(CLI::App& app);

}  // namespace segsim::experiments::commands
