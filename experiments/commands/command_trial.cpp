// `segsim trial check` and `run`.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/commands.h"
#include "experiments/scripted_trials/scripted_run.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

struct TrialFlags {
  fs::path file, data, output;
};

void check(const TrialFlags& flags) {
  const ScriptedTrial script = load_scripted_trial(flags.file, flags.data);
  (void)bind_script(script);
  std::printf("%s: %zu steps, %zu faults, %zu expectations\n", flags.file.c_str(),
              script.steps.size(), script.fault_words.size(), script.expectations.size());
}

void run(TrialFlags& flags) {
  const ScriptedTrial script = load_scripted_trial(flags.file, flags.data);
  if (flags.output.empty()) flags.output = fs::path("out") / "trials" / script.name;
  BoundScript bound = bind_script(script);
  const ScriptedResult result = run_script(bound, flags.output);
  std::fputs(in_words(script, result).c_str(), stdout);
  std::printf("%s\n", flags.output.c_str());
  if (!result.passed()) throw core::CheckFailed(script.name + " did not pass");
}

void add_flags(CLI::App& command, const std::shared_ptr<TrialFlags>& flags) {
  command.add_option("file", flags->file, "Scripted trial (YAML)")->required();
  command.add_option("--data", flags->data, "Folder that ${data} stands for");
}

}  // namespace

void add_trial_command(CLI::App& app) {
  CLI::App* trial = app.add_subcommand(
      "trial", "Scripted trials: where to drive, what goes wrong, what must hold");
  trial->require_subcommand(1);

  auto flags = std::make_shared<TrialFlags>();
  CLI::App* checks = trial->add_subcommand(
      "check", "Read a file and check it against its scene, without driving");
  add_flags(*checks, flags);
  checks->callback([flags] { check(*flags); });

  CLI::App* runs = trial->add_subcommand(
      "run", "Drive it. Exit code 1 if a step was not done or an expectation does not hold");
  add_flags(*runs, flags);
  runs->add_option("-o,--output", flags->output,
                   "Folder for results (default: out/trials/<name of the file>)");
  runs->callback([flags] { run(*flags); });
}

}  // namespace segsim::experiments
