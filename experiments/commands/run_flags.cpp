#include "experiments/commands/run_flags.h"

#include <cstdio>
#include <utility>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/interrupted.h"
#include "core/process/kernel_choice.h"

namespace segsim::experiments::commands {

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

std::string with_flags(std::string spec_text, const RunFlags& flags) {
  if (flags.backend.empty()) return spec_text;
  return specs::with_backend(std::move(spec_text), renderer::backend_of(flags.backend));
}

runs::RunReport run_and_print(const specs::ExperimentSpec& spec, const RunFlags& flags) {
  runs::RunReport report = runs::run_experiment(spec, flags.options);
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
  return report;
}

void add_run_flags(CLI::App& command, RunFlags& flags) {
  command.add_option("--data", flags.options.folders.data,
                     "Folder that ${data} in the spec stands for");
  command.add_option("--work", flags.options.folders.work,
                     "Folder for everything that is made (default: out/<name of the spec>)");
  command
      .add_option("--workers", flags.options.workers,
                  "Trials, and before them scenes and trainings, at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command
      .add_option("--max-trials", flags.options.max_trials,
                  "Stop after so many trials (0 = all)")
      ->check(CLI::NonNegativeNumber);
  command
      .add_option("--backend", flags.backend,
                  "cpu | cuda: what draws, trains and detects (default: as the spec says, or "
                  "the CPU)")
      ->check(CLI::IsMember({"cpu", "cuda"}));
  CLI::Option* shard = command.add_option(
      "--shard", flags.shard,
      "Run one part, beside workers with the others: I/N (0 <= I < N), or auto: as the batch "
      "engine's variables say. Then `segsim merge`. See docs/scale_out.md");
  command
      .add_flag("--new", flags.options.new_run,
                "Begin a new run, even if an unfinished or different one is there")
      ->excludes(shard);
  command
      .add_flag("--prepare-only", flags.options.prepare_only,
                "Make bundles, detectors and episodes, but run no trial")
      ->excludes(shard);
}

}  // namespace segsim::experiments::commands
