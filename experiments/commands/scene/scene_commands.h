#pragma once

/// @file
/// `segsim scene`: looks at bundles, mends them, corrects their labels. One function for each
/// subcommand, as in experiments/commands/commands.h.

#include "experiments/commands/light/light_commands.h"

namespace segsim::experiments::commands::scene {

void add_scene_command(CLI::App& app);
/// `segsim scene remesh` and `segsim scene mesh-error`, below `segsim scene`.
void add_scene_mesh(CLI::App& scene);
/// `segsim scene label`, below `segsim scene`.
void add_scene_label(CLI::App& scene);
/// `segsim scene coverage`, below `segsim scene`.
void add_scene_coverage(CLI::App& scene);
/// `segsim scene query`, below `segsim scene`.
void add_scene_query(CLI::App& scene);

}  // namespace segsim::experiments::commands::scene
