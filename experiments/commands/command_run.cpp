// `segsim run` and `segsim merge`.
#include <cstdio>
#include <memory>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/run_flags.h"
#include "experiments/results/stored_run.h"
#include "experiments/runs/merge_runs.h"
#include "experiments/runs/run.h"
#include "experiments/support/shipped_file.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags : RunFlags {
  std::string spec;
};

void run(Flags& flags) {
  if (!flags.shard.empty()) flags.options.shard = runs::shard_from(flags.shard);
  const fs::path file = support::find_shipped(flags.spec);
  const specs::ExperimentSpec spec =
      specs::parse_spec(with_flags(core::read_file(file), flags), file, flags.options.folders);
  check_end(run_and_print(spec, flags));
}

struct MergeFlags {
  fs::path out;
  std::vector<fs::path> shards;
};

void merge(const MergeFlags& flags) {
  const std::vector<fs::path> shards =
      flags.shards.empty() ? runs::shard_folders(flags.out) : flags.shards;
  if (shards.empty()) {
    throw core::InputError::expected((flags.out / "shards").string(),
                                     "shards of segsim run --shard", "none");
  }
  const runs::MergeReport report = runs::merge_runs(flags.out, shards);
  std::fputs(results::format_table(report.table, support::TableFormat::kText).c_str(), stdout);
  std::printf("\nMerged %zu shards into %s: %d trials added, %d known, %d failed.\n",
              shards.size(), flags.out.c_str(), report.added, report.known, report.failed);
  std::printf("%d of %d trials are done. SHA-256 of the results: %s\n",
              report.table.finished_trials, report.table.run.planned_trials,
              report.results_sha256.c_str());
}

void add_merge_command(CLI::App& app) {
  auto flags = std::make_shared<MergeFlags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "merge");
  command->add_option("out", flags->out, "Work folder that gets the whole run")->required();
  command->add_option("shards", flags->shards,
                      "Folders of shards, or their databases (default: all in OUT/shards)");
  command->callback([flags] { merge(*flags); });
}

}  // namespace

void add_run_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "run");
  command->add_option("spec", flags->spec, "Experiment (YAML), see experiments/specs/")
      ->required();
  add_run_flags(*command, *flags);
  command->callback([flags] { run(*flags); });
  add_merge_command(app);
}

}  // namespace segsim::experiments::commands
