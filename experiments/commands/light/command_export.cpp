// `segsim export`: a run for other programs.
#include <cstdio>
#include <memory>
#include <ostream>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/light/light_commands.h"
#include "experiments/results/trial_export.h"

namespace segsim::experiments::commands::light {
namespace {

struct Flags {
  std::filesystem::path work, output;
  std::int64_t run_id = 0;
};

void export_run(const Flags& flags) {
  const std::string ending = flags.output.extension().string();
  if (ending != ".csv" && ending != ".jsonl") {
    throw core::InputError::expected("--output", "a file name that ends in .csv or .jsonl",
                                     flags.output.string());
  }
  const results::StoredRun stored = results::load_run(flags.work, flags.run_id);
  core::write_file_atomically(flags.output, [&](std::ostream& out) {
    if (ending == ".csv") {
      records::write_trials_csv(out, stored.trials);
    } else {
      results::write_trials_jsonl(out, stored);
    }
  });
  std::printf("%s: %zu trials\n", flags.output.c_str(), stored.trials.size());
}

}  // namespace

void add_export_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = add_listed(app, kCommands, "export");
  command->add_option("run", flags->work, "Work folder of `segsim run`, or a results database")
      ->required();
  command
      ->add_option("-o,--output", flags->output,
                   "File: .csv (trials), .jsonl (the run with its provenance, then trials)")
      ->required();
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->callback([flags] { export_run(*flags); });
}

}  // namespace segsim::experiments::commands::light
