// `segsim table WORK` and `segsim table 3`.
#include <cstdio>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/light/light_commands.h"
#include "experiments/results/navigation_table.h"
#include "experiments/results/stored_run.h"

namespace segsim::experiments::commands::light {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path room, house, output;
  std::vector<fs::path> others;
  std::string format = "text";
};

/// @param work  Empty: where the shipped spec leaves it; only then may it be missing.
results::NavigationEntry entry_of(const char* paper_scene, const char* title,
                                  const fs::path& work, const std::string& spec) {
  results::NavigationEntry entry{paper_scene, title, std::nullopt, {}};
  const fs::path folder = work.empty() ? fs::path("out") / spec : work;
  if (work.empty() && !fs::exists(folder / "results.sqlite")) {
    entry.missing = "make it with segsim run experiments/specs/" + spec + ".yaml --data DIR";
    return entry;
  }
  entry.result = results::summarise(results::load_run(folder));
  return entry;
}

void print_table3(const Flags& flags) {
  const support::TableFormat format = results::table_format_from(flags.format);
  std::vector<results::NavigationEntry> entries{
      entry_of("Laboratory Room", "Break room", flags.room, "chain_breakroom"),
      entry_of("House", "House", flags.house, "chain_house")};
  for (const fs::path& work : flags.others) {
    entries.push_back({"", work.string(), results::summarise(results::load_run(work)), {}});
  }
  if (!flags.output.empty()) {
    results::write_table_files(flags.output, "table3", [&](support::TableFormat form) {
      return results::format_navigation_table(entries, form);
    });
  }
  std::fputs(results::format_navigation_table(entries, format).c_str(), stdout);
}

struct TableFlags {
  std::filesystem::path work;
  std::string format = "text", before, after;
  std::int64_t run_id = 0;
};

void print_table(const TableFlags& flags) {
  const support::TableFormat format = results::table_format_from(flags.format);
  if (flags.work.empty()) {
    throw core::InputError::expected("segsim table", "a work folder, or 1, 2, 3 or all",
                                     "nothing");
  }
  const results::ResultTable table = results::summarise(
      results::load_run(flags.work, flags.run_id), flags.before, flags.after);
  std::fputs(results::format_table(table, format).c_str(), stdout);
}

}  // namespace

CLI::App& add_run_table(CLI::App& app) {
  auto flags = std::make_shared<TableFlags>();
  CLI::App* command = add_listed(app, kCommands, "table");
  command->add_option("work", flags->work,
                      "Work folder of `segsim run`, or a results database");
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->add_option("--before", flags->before, "Arm to compare from (default: before)");
  command->add_option("--after", flags->after, "Arm to compare with (default: after)");
  command->callback([flags, command] {
    if (!command->get_subcommands().empty()) return;  // It has printed its own table.
    print_table(*flags);
  });
  return *command;
}

void add_navigation_table(CLI::App& table) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = add_listed(table, kTableCommands, "3");
  command->add_option(
      "--room", flags->room,
      "Work folder for the paper's Laboratory Room (default: out/chain_breakroom)");
  command->add_option("--house", flags->house,
                      "Work folder for the paper's House (default: out/chain_house)");
  command
      ->add_option("--other", flags->others, "Work folders of further runs, one row a scene")
      ->allow_extra_args(false);
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->add_option("-o,--output", flags->output,
                      "Folder for table3.txt, .md, .tex, .csv and .json");
  command->callback([flags] { print_table3(*flags); });
}

}  // namespace segsim::experiments::commands::light
