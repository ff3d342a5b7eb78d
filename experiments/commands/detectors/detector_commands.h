#pragma once

/// @file
/// `segsim detector`, and what detectors learn from: `segsim label` and `segsim masks`. One
/// function for each subcommand, as in experiments/commands/commands.h.

#include "experiments/commands/light/light_commands.h"

namespace segsim::experiments::commands::detectors {

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
void add_evaluate_command(CLI::App& app);
/// `segsim masks detect` and `segsim masks make`, below `segsim masks`.
void add_masks_detect(CLI::App& masks);
void add_masks_make(CLI::App& masks);

}  // namespace segsim::experiments::commands::detectors
