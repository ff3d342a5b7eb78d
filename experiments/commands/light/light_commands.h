#pragma once

/// @file
/// The subcommands that start at once: they read results and files, and link neither libtorch
/// nor OpenCV's codecs. One function for each, as in experiments/commands/commands.h.

#include <filesystem>
#include <string_view>

#include "experiments/commands/light/command_list.h"

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class App;
}

namespace segsim::experiments::commands::light {

/// Adds the subcommand of this name with the help that its list has.
CLI::App* add_listed(CLI::App& parent, std::span<const CommandWord> list,
                     std::string_view name);
/// `segsim table WORK`, without the tables of the paper. @return It.
CLI::App& add_run_table(CLI::App& app);
/// `segsim table 3`, below `segsim table`.
void add_navigation_table(CLI::App& table);
void add_compare_command(CLI::App& app);
void add_plan_command(CLI::App& app);
void add_export_command(CLI::App& app);
void add_robots_command(CLI::App& app);
/// `segsim suite` without its subcommands. @return It.
CLI::App& add_suite_group(CLI::App& app);
/// `segsim suite list`, `show` and `verify`, below `segsim suite`.
void add_suite_list(CLI::App& suite);
void add_suite_show(CLI::App& suite);
void add_suite_verify(CLI::App& suite);
/// `segsim trial` without its subcommands. @return It.
CLI::App& add_trial_group(CLI::App& app);
/// `segsim trial check`, below `segsim trial`.
void add_trial_check(CLI::App& trial);

/// What all commands about a scripted trial are told.
struct ScriptFlags {
  std::filesystem::path file, data;
};
/// @param flags  Outlives the command.
void add_script_flags(CLI::App& command, ScriptFlags& flags);

/// All of `segsim`: what is light, and the names of the rest.
void add_light_commands(CLI::App& app);

}  // namespace segsim::experiments::commands::light
