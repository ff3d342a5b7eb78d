// `segsim run` and `segsim table`.
#include <cstdio>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/commands.h"
#include "experiments/runs/run.h"
#include "experiments/store/stored_run.h"

namespace segsim::experiments {
namespace {

struct RunFlags {
  std::string spec;
  RunOptions options;
};

void run(RunFlags& flags) {
  const ExperimentSpec spec = load_spec(flags.spec, flags.options.folders);
  const RunReport report = run_experiment(spec, flags.options);
  std::fputs(format_table(report.table, TableFormat::kText).c_str(), stdout);
  std::printf("\nResults in %s\n", flags.options.folders.work.c_str());
  if (report.interrupted) {
    std::printf("Stopped with %d trials left; run the same command again to go on.\n",
                report.trials_left);
  }
  int failed = 0;
  for (const GroupSummary& scene : report.table.scenes) {
    for (const ArmSummary& arm : scene.arms) failed += arm.failed_trials;
  }
  if (failed > 0) {
    throw core::CheckFailed(std::to_string(failed) +
                            " trials failed in the harness; run again to repeat them");
  }
}

struct TableFlags {
  std::filesystem::path work;
  std::string format = "text", before, after;
  std::int64_t run_id = 0;
};

void print_table(const TableFlags& flags) {
  const TableFormat format = table_format_from(flags.format);
  if (flags.work.empty()) {
    throw core::InputError::expected("segsim table", "a work folder, or 1, 2, 3 or all",
                                     "nothing");
  }
  const ResultTable table =
      summarise(load_run(flags.work, flags.run_id), flags.before, flags.after);
  std::fputs(format_table(table, format).c_str(), stdout);
}

}  // namespace

void add_run_command(CLI::App& app) {
  auto flags = std::make_shared<RunFlags>();
  CLI::App* command = app.add_subcommand(
      "run", "Run an experiment: prepare, run all trials, print the table. Resumes.");
  command->add_option("spec", flags->spec, "Experiment (YAML), see experiments/specs/")
      ->required();
  command->add_option("--data", flags->options.folders.data,
                      "Folder that ${data} in the spec stands for");
  command->add_option("--work", flags->options.folders.work,
                      "Folder for everything that is made (default: out/<name of the spec>)");
  command->add_option("--workers", flags->options.workers, "Trials at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command
      ->add_option("--max-trials", flags->options.max_trials,
                   "Stop after so many trials (0 = all)")
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--new", flags->options.new_run,
                    "Begin a new run, even if an unfinished or different one is there");
  command->add_flag("--prepare-only", flags->options.prepare_only,
                    "Make bundles, detectors and episodes, but run no trial");
  command->callback([flags] { run(*flags); });
}

void add_table_command(CLI::App& app) {
  auto flags = std::make_shared<TableFlags>();
  CLI::App* command = app.add_subcommand(
      "table",
      "Print the table of a run, or one of the paper's: text, Markdown, LaTeX, CSV, JSON");
  command->add_option("work", flags->work,
                      "Work folder of `segsim run`, or a results database");
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->add_option("--before", flags->before, "Arm to compare from (default: before)");
  command->add_option("--after", flags->after, "Arm to compare with (default: after)");
  add_panoptic_table(*command);
  add_ablation_table(*command);
  add_navigation_table(*command);
  add_all_tables(*command);
  command->callback([flags, command] {
    if (!command->get_subcommands().empty()) return;  // It has printed its own table.
    print_table(*flags);
  });
}

}  // namespace segsim::experiments
