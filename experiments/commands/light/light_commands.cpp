#include "experiments/commands/light/light_commands.h"

#include <string>

#include <CLI/CLI.hpp>

#include "core/check.h"

namespace segsim::experiments::commands::light {
namespace {

/// The name of a subcommand of segsim-main, so that --help has it.
void add_name_only(CLI::App& parent, const CommandWord& word) {
  CLI::App* command = parent.add_subcommand(word.name, word.help);
  command->prefix_command();  // Its flags are not for this program.
  command->callback([name = std::string(word.name)] {
    SEGSIM_CHECK(false, "segsim-main does " + name + ": start segsim");
  });
}

struct Adder {
  const char* name;
  void (*add)(CLI::App& parent);
};

/// Adds what `adders` can, and the names of the rest, in the order of the list.
void add_all(CLI::App& parent, std::span<const CommandWord> list,
             std::span<const Adder> adders) {
  for (const CommandWord& word : list) {
    const auto found = std::find_if(adders.begin(), adders.end(), [&](const Adder& adder) {
      return std::string_view(adder.name) == word.name;
    });
    SEGSIM_CHECK(word.light == (found != adders.end()), word.name);
    if (word.light) {
      found->add(parent);
    } else {
      add_name_only(parent, word);
    }
  }
}

void add_table(CLI::App& app) {
  static constexpr Adder kAdders[] = {{"3", add_navigation_table}};
  add_all(add_run_table(app), kTableCommands, kAdders);
}

void add_suite(CLI::App& app) {
  static constexpr Adder kAdders[] = {
      {"list", add_suite_list}, {"show", add_suite_show}, {"verify", add_suite_verify}};
  add_all(add_suite_group(app), kSuiteCommands, kAdders);
}

void add_trial(CLI::App& app) {
  static constexpr Adder kAdders[] = {{"check", add_trial_check}};
  add_all(add_trial_group(app), kTrialCommands, kAdders);
}

}  // namespace

CLI::App* add_listed(CLI::App& parent, std::span<const CommandWord> list,
                     std::string_view name) {
  const CommandWord* word = find_command(list, name);
  SEGSIM_CHECK(word != nullptr, std::string(name) + " is not in the list");
  return parent.add_subcommand(word->name, word->help);
}

CLI::App& add_trial_group(CLI::App& app) {
  CLI::App* trial = add_listed(app, kCommands, "trial");
  trial->require_subcommand(1);
  return *trial;
}

void add_light_commands(CLI::App& app) {
  static constexpr Adder kAdders[] = {{"table", add_table},
                                      {"suite", add_suite},
                                      {"compare", add_compare_command},
                                      {"plan", add_plan_command},
                                      {"export", add_export_command},
                                      {"robots", add_robots_command},
                                      {"trial", add_trial}};
  add_all(app, kCommands, kAdders);
}

}  // namespace segsim::experiments::commands::light
