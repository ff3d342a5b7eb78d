// `segsim trial check`.
#include <cstdio>
#include <memory>

#include <CLI/CLI.hpp>

#include "experiments/commands/light/light_commands.h"
#include "experiments/scripted_trials/scripted_run.h"
#include "experiments/support/shipped_file.h"

namespace segsim::experiments::commands::light {
namespace {

void check(const ScriptFlags& flags) {
  const scripted_trials::ScriptedTrial script =
      scripted_trials::load_scripted_trial(support::find_shipped(flags.file), flags.data);
  scripted_trials::check_script(script);
  std::printf("%s: %zu steps, %zu faults, %zu expectations\n", flags.file.c_str(),
              script.steps.size(), script.fault_words.size(), script.expectations.size());
}

}  // namespace

void add_script_flags(CLI::App& command, ScriptFlags& flags) {
  command.add_option("file", flags.file, "Scripted trial (YAML)")->required();
  command.add_option("--data", flags.data, "Folder that ${data} stands for");
}

void add_trial_check(CLI::App& trial) {
  auto flags = std::make_shared<ScriptFlags>();
  CLI::App* command = add_listed(trial, kTrialCommands, "check");
  add_script_flags(*command, *flags);
  command->callback([flags] { check(*flags); });
}

}  // namespace segsim::experiments::commands::light
