// `segsim trial run`.
#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/commands.h"
#include "experiments/scripted_trials/scripted_run.h"
#include "experiments/support/shipped_file.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct RunFlags {
  light::ScriptFlags script;
  fs::path output;
};

void run(RunFlags& flags) {
  const scripted_trials::ScriptedTrial script = scripted_trials::load_scripted_trial(
      support::find_shipped(flags.script.file), flags.script.data);
  if (flags.output.empty()) flags.output = fs::path("out") / "trials" / script.name;
  scripted_trials::BoundScript bound = scripted_trials::bind_script(script);
  const scripted_trials::ScriptedResult result =
      scripted_trials::run_script(bound, flags.output);
  std::fputs(scripted_trials::in_words(script, result).c_str(), stdout);
  std::printf("%s\n", flags.output.c_str());
  if (!result.passed()) throw core::CheckFailed(script.name + " did not pass");
}

}  // namespace

void add_trial_command(CLI::App& app) {
  CLI::App& trial = light::add_trial_group(app);
  light::add_trial_check(trial);
  auto flags = std::make_shared<RunFlags>();
  CLI::App* command = light::add_listed(trial, light::kTrialCommands, "run");
  light::add_script_flags(*command, flags->script);
  command->add_option("-o,--output", flags->output,
                      "Folder for results (default: out/trials/<name of the file>)");
  command->callback([flags] { run(*flags); });
}

}  // namespace segsim::experiments::commands
