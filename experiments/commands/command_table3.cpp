// `segsim table 3` and `segsim table all`.
#include <cstdio>
#include <memory>
#include <ostream>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/commands.h"
#include "experiments/results/navigation_table.h"
#include "experiments/results/stored_run.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path room, house, output;
  std::vector<fs::path> others;
  std::string format = "text";
};

/// @param work  Empty: where the shipped spec leaves it; only then may it be missing.
NavigationEntry entry_of(const char* paper_scene, const char* title, const fs::path& work,
                         const std::string& spec) {
  NavigationEntry entry{paper_scene, title, std::nullopt, {}};
  const fs::path folder = work.empty() ? fs::path("out") / spec : work;
  if (work.empty() && !fs::exists(folder / "results.sqlite")) {
    entry.missing = "make it with segsim run experiments/specs/" + spec + ".yaml --data DIR";
    return entry;
  }
  entry.result = summarise(load_run(folder));
  return entry;
}

void print_table3(const Flags& flags) {
  const TableFormat format = table_format_from(flags.format);
  std::vector<NavigationEntry> entries{
      entry_of("Laboratory Room", "Break room", flags.room, "breakroom"),
      entry_of("House", "House", flags.house, "house")};
  for (const fs::path& work : flags.others) {
    entries.push_back({"", work.string(), summarise(load_run(work)), {}});
  }
  if (!flags.output.empty()) {
    for (const auto& [ending, form] : table_files()) {
      core::write_file_atomically(flags.output / ("table3" + ending), [&](std::ostream& out) {
        out << format_navigation_table(entries, form);
      });
    }
  }
  std::fputs(format_navigation_table(entries, format).c_str(), stdout);
}

struct AllFlags {
  fs::path output, data, table1_work, room, house;
  std::vector<fs::path> others;
  bool quick = false;
};

/// What a shell would pass as one word.
std::string word(const fs::path& path) { return "\"" + path.string() + "\""; }

/// The same as the commands one by one, so that no table can differ from its own command's.
void make_all_tables(const AllFlags& flags) {
  const fs::path table1_work =
      flags.table1_work.empty() ? flags.output / "table1" : flags.table1_work;
  std::string first = "table 1 --resume --work " + word(table1_work);
  if (!flags.data.empty()) first += " --data " + word(flags.data);
  std::string second = "table 2 -o " + word(flags.output);
  if (flags.quick) {
    first += " --quick";
    second += " --surfels 20000 --views 2 --repeat 1 --size 320x240";
  }
  std::string third = "table 3 -o " + word(flags.output);
  if (!flags.room.empty()) third += " --room " + word(flags.room);
  if (!flags.house.empty()) third += " --house " + word(flags.house);
  for (const fs::path& work : flags.others) third += " --other " + word(work);
  for (const std::string& command : {third, second, first}) {  // What takes hours comes last.
    CLI::App app;
    add_table_command(app);
    app.parse(command, false);
    std::printf("\n");
  }
  for (const auto& [ending, format] : table_files()) {
    const std::string name = "table1" + ending;
    const std::string text = core::read_file(table1_work / name);
    core::write_file_atomically(flags.output / name, [&](std::ostream& out) { out << text; });
  }
  std::printf("Tables in %s: table1, table2, table3 as txt, md, tex, csv and json\n",
              flags.output.c_str());
}

}  // namespace

void add_navigation_table(CLI::App& table) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = table.add_subcommand(
      "3", "The paper's Table 3: success before and after fine-tuning, with intervals and p");
  command->add_option("--room", flags->room,
                      "Work folder for the paper's Laboratory Room (default: out/breakroom)");
  command->add_option("--house", flags->house,
                      "Work folder for the paper's House (default: out/house)");
  command
      ->add_option("--other", flags->others, "Work folders of further runs, one row a scene")
      ->allow_extra_args(false);
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->add_option("-o,--output", flags->output,
                      "Folder for table3.txt, .md, .tex, .csv and .json");
  command->callback([flags] { print_table3(*flags); });
}

void add_all_tables(CLI::App& table) {
  auto flags = std::make_shared<AllFlags>();
  CLI::App* command = table.add_subcommand(
      "all",
      "Every table of the paper into one folder (Table 1 trains: hours without --quick)");
  command->add_option("-o,--output", flags->output, "Folder")->required();
  command->add_option("--data", flags->data, "Table 1: folder of the data");
  command->add_option("--table1-work", flags->table1_work,
                      "Table 1: work folder, what is finished there is kept (default: table1/ "
                      "in the output)");
  command->add_option("--room", flags->room, "Table 3: see there");
  command->add_option("--house", flags->house, "Table 3: see there");
  command->add_option("--other", flags->others, "Table 3: see there")->allow_extra_args(false);
  command->add_flag("--quick", flags->quick,
                    "Tiny tables 1 and 2, to see that it runs: no result");
  command->callback([flags] { make_all_tables(*flags); });
}

}  // namespace segsim::experiments
