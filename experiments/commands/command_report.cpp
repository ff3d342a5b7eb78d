// `segsim report`: a run as a folder of HTML.
#include <cstdio>
#include <memory>

#include <CLI/CLI.hpp>

#include "experiments/commands/commands.h"
#include "experiments/report/report.h"

namespace segsim::experiments::commands {
namespace {

struct Flags {
  std::filesystem::path work;
  std::int64_t run_id = 0;
  report::ReportOptions options;
};

void report(Flags& flags) {
  const results::StoredRun stored = results::load_run(flags.work, flags.run_id);
  if (flags.options.output.empty()) flags.options.output = stored.folder / "report";
  const report::ReportSummary summary = report::write_report(stored, flags.options);
  for (const std::string& note : summary.notes) {
    std::fprintf(stderr, "segsim: note: %s\n", note.c_str());
  }
  std::printf("%s: %d pages, %d pictures, %.1f MB\n", summary.index.c_str(), summary.pages,
              summary.pictures, static_cast<double>(summary.bytes) / 1e6);
}

}  // namespace

void add_report_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "report");
  command->add_option("run", flags->work, "Work folder of `segsim run`, or a results database")
      ->required();
  command->add_option("-o,--output", flags->options.output,
                      "Folder (default: report/ in the work folder)");
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->add_option("--before", flags->options.before, "Arm to compare from");
  command->add_option("--after", flags->options.after, "Arm to compare with");
  command->add_flag("!--no-pictures", flags->options.pictures,
                    "Neither maps nor filmstrips; needs no bundle");
  command
      ->add_option("--threads", flags->options.threads,
                   "That draw pictures (0: one per processor)")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->callback([flags] { report(*flags); });
}

}  // namespace segsim::experiments::commands
