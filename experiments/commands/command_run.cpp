// `segsim run` and `segsim merge`.
#include <cstdio>
#include <memory>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/interrupted.h"
#include "core/process/kernel_choice.h"
#include "experiments/commands/commands.h"
#include "experiments/results/stored_run.h"
#include "experiments/runs/merge_runs.h"
#include "experiments/runs/run.h"
#include "experiments/support/shipped_file.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct RunFlags {
  std::string spec, shard;
  runs::RunOptions options;
};

/// @throws what its exit code stands for, if the run did not end well.
void check_end(const runs::RunReport& report) {
  if (report.interrupted && report.trials_left > 0) {
    throw core::Interrupted("stopped with " + std::to_string(report.trials_left) +
                            " trials left; run the same command again to go on");
  }
  if (report.trials_failed > 0) {
    throw core::CheckFailed(std::to_string(report.trials_failed) +
                            " trials failed in the harness; run again to repeat them");
  }
}

void run(RunFlags& flags) {
  if (!flags.shard.empty()) flags.options.shard = runs::shard_from(flags.shard);
  const specs::ExperimentSpec spec =
      specs::load_spec(support::find_shipped(flags.spec), flags.options.folders);
  const runs::RunReport report = runs::run_experiment(spec, flags.options);
  if (flags.options.shard) {
    std::printf("Shard %s: %d trials run, %d left; storing them took %.2f s\n",
                flags.options.shard->text().c_str(), report.trials_run, report.trials_left,
                report.store_s);
  } else {
    std::fputs(results::format_table(report.table, support::TableFormat::kText).c_str(),
               stdout);
    std::printf(
        "\nDigests of the stages (%s kernels; segsim doctor --digests %s compares them):\n%s",
        core::to_string(core::kernel_choice()), report.results.c_str(),
        reproducibility::digests_in_words(report.digests).c_str());
  }
  std::fputs(support::stage_times_text(report.times, report.wall_s).c_str(), stdout);
  std::printf("\nResults in %s, SHA-256 %s\n", report.results.c_str(),
              report.results_sha256.c_str());
  check_end(report);
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
  CLI::App* command = add_listed(app, kCommands, "merge");
  command->add_option("out", flags->out, "Work folder that gets the whole run")->required();
  command->add_option("shards", flags->shards,
                      "Folders of shards, or their databases (default: all in OUT/shards)");
  command->callback([flags] { merge(*flags); });
}

}  // namespace

void add_run_command(CLI::App& app) {
  auto flags = std::make_shared<RunFlags>();
  CLI::App* command = add_listed(app, kCommands, "run");
  command->add_option("spec", flags->spec, "Experiment (YAML), see experiments/specs/")
      ->required();
  command->add_option("--data", flags->options.folders.data,
                      "Folder that ${data} in the spec stands for");
  command->add_option("--work", flags->options.folders.work,
                      "Folder for everything that is made (default: out/<name of the spec>)");
  command
      ->add_option("--workers", flags->options.workers,
                   "Trials, and before them scenes and trainings, at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command
      ->add_option("--max-trials", flags->options.max_trials,
                   "Stop after so many trials (0 = all)")
      ->check(CLI::NonNegativeNumber);
  CLI::Option* shard = command->add_option(
      "--shard", flags->shard,
      "Run one part, beside workers with the others: I/N (0 <= I < N), or auto: as the batch "
      "engine's variables say. Then `segsim merge`. See docs/scale_out.md");
  command
      ->add_flag("--new", flags->options.new_run,
                 "Begin a new run, even if an unfinished or different one is there")
      ->excludes(shard);
  command
      ->add_flag("--prepare-only", flags->options.prepare_only,
                 "Make bundles, detectors and episodes, but run no trial")
      ->excludes(shard);
  command->callback([flags] { run(*flags); });
  add_merge_command(app);
}

}  // namespace segsim::experiments::commands
