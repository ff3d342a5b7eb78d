#pragma once

/// @file
/// One function per subcommand of `segsim`: declares its flags and registers what runs when it
/// was named. Errors are thrown: core::InputError, core::CheckFailed; main() turns them into
/// exit codes.

#include "experiments/commands/light/light_commands.h"

namespace segsim::experiments::commands {

void add_run_command(CLI::App& app);
void add_table_command(CLI::App& app);
void add_capture_command(CLI::App& app);
void add_reconstruct_command(CLI::App& app);
void add_scene_command(CLI::App& app);
/// `segsim scene remesh` and `segsim scene mesh-error`, below `segsim scene`.
void add_scene_mesh(CLI::App& scene);
/// `segsim scene label`, below `segsim scene`.
void add_scene_label(CLI::App& scene);
/// `segsim scene coverage`, below `segsim scene`.
void add_scene_coverage(CLI::App& scene);
void add_render_command(CLI::App& app);
void add_label_command(CLI::App& app);
void add_detector_command(CLI::App& app);
/// `segsim detector train`, `finetune` and `pretrain`, below `segsim detector`.
void add_detector_training(CLI::App& detector);
/// `segsim detector import` and `segsim detector forward`, below `segsim detector`.
void add_detector_import(CLI::App& detector);
void add_detector_forward(CLI::App& detector);
/// `segsim detector compare` and `segsim detector score`.
void add_detector_compare(CLI::App& detector);
void add_masks_command(CLI::App& app);
/// `segsim masks detect` and `segsim masks make`, below `segsim masks`.
void add_masks_detect(CLI::App& masks);
void add_masks_make(CLI::App& masks);
/// `segsim gazebo serve` and `segsim gazebo export-world`.
void add_gazebo_command(CLI::App& app);
void add_bench_command(CLI::App& app);
void add_budget_command(CLI::App& app);
void add_replay_command(CLI::App& app);
void add_robots_command(CLI::App& app);
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

}  // namespace segsim::experiments::commands
