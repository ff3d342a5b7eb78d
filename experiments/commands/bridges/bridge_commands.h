#pragma once

/// @file
/// `segsim gazebo` and `segsim ros`: robots and cameras of running systems. One function for
/// each subcommand, as in experiments/commands/commands.h.

#include "experiments/commands/light/light_commands.h"

namespace segsim::experiments::commands::bridges {

/// `segsim gazebo serve`, `export-world` and `drive`.
void add_gazebo_command(CLI::App& app);
/// `segsim gazebo drive`, below `segsim gazebo`.
void add_gazebo_drive(CLI::App& gazebo);
/// `segsim ros serve`.
void add_ros_command(CLI::App& app);

}  // namespace segsim::experiments::commands::bridges
