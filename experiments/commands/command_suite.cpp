// `segsim suite run` and `segsim suite table`.
#include <cstdio>
#include <memory>

#include <CLI/CLI.hpp>

#include "experiments/commands/commands.h"
#include "experiments/commands/run_flags.h"
#include "experiments/report/suite_page.h"
#include "experiments/results/stored_run.h"
#include "experiments/suites/manifest.h"
#include "experiments/suites/suite.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFolder = "suite";

struct Flags : RunFlags {
  std::string suite;
};

/// A folder that says that it holds another suite is left alone.
void check_folder(const suites::Suite& suite, const fs::path& work) {
  const fs::path file = work / kFolder / "manifest.json";
  if (!fs::exists(file)) return;
  suites::Manifest now = suites::read_manifest(file), wanted = now;
  wanted.suite = suite.name;
  for (auto& [what, sha256] : wanted.hashes) {
    if (what == "suite") sha256 = suite.sha256();
  }
  suites::expect_same(wanted, suite.file.string(), now, file.string());
}

void write_files(const results::StoredRun& stored) {
  const fs::path page = report::write_suite_page(stored, stored.folder / kFolder);
  std::printf("%s, with episodes.csv, episodes.jsonl and manifest.json\n", page.c_str());
}

void run(Flags& flags) {
  const suites::Suite suite = suites::load_suite(flags.suite);
  if (!flags.shard.empty()) flags.options.shard = runs::shard_from(flags.shard);
  const specs::ExperimentSpec spec = specs::parse_spec(
      with_flags(suite.spec_text, flags), suite.spec_origin(), flags.options.folders);
  if (!flags.options.new_run) check_folder(suite, flags.options.folders.work);
  const runs::RunReport report = run_and_print(spec, flags);
  if (!flags.options.shard) write_files(results::load_run(report.results));
  check_end(report);
}

struct TableFlags {
  fs::path work;
  std::int64_t run_id = 0;
  std::string format = "text";
};

void table(const TableFlags& flags) {
  const support::TableFormat format = results::table_format_from(flags.format);
  const results::StoredRun stored = results::load_run(flags.work, flags.run_id);
  std::fputs(results::format_table(results::summarise(stored), format).c_str(), stdout);
  write_files(stored);
}

}  // namespace

void add_suite_command(CLI::App& app) {
  CLI::App& suite = light::add_suite_group(app);
  light::add_suite_list(suite);
  light::add_suite_show(suite);
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(suite, light::kSuiteCommands, "run");
  command->add_option("suite", flags->suite, "Name of a suite, or its file (YAML)")
      ->required();
  add_run_flags(*command, *flags);
  command->callback([flags] { run(*flags); });

  auto table_flags = std::make_shared<TableFlags>();
  command = light::add_listed(suite, light::kSuiteCommands, "table");
  command
      ->add_option("run", table_flags->work,
                   "Work folder of `segsim suite run`, or of merged "
                   "shards")
      ->required();
  command->add_option("--run", table_flags->run_id, "Number of the run (default: the last)");
  command->add_option("--format", table_flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->callback([table_flags] { table(*table_flags); });
  light::add_suite_verify(suite);
}

}  // namespace segsim::experiments::commands
