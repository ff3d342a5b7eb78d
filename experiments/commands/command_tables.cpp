// `segsim table all`, and all tables together.
#include <cstdio>
#include <memory>
#include <ostream>

#include <CLI/CLI.hpp>

#include "core/file_io.h"
#include "experiments/commands/commands.h"
#include "experiments/results/table.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

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
  for (const auto& [ending, format] : results::table_files()) {
    const std::string name = "table1" + ending;
    const std::string text = core::read_file(table1_work / name);
    core::write_file_atomically(flags.output / name, [&](std::ostream& out) { out << text; });
  }
  std::printf("Tables in %s: table1, table2, table3 as txt, md, tex, csv and json\n",
              flags.output.c_str());
}

void add_all_tables(CLI::App& table) {
  auto flags = std::make_shared<AllFlags>();
  CLI::App* command = light::add_listed(table, light::kTableCommands, "all");
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

}  // namespace

void add_table_command(CLI::App& app) {
  CLI::App& table = light::add_run_table(app);
  add_panoptic_table(table);
  add_ablation_table(table);
  light::add_navigation_table(table);
  add_all_tables(table);
}

}  // namespace segsim::experiments::commands
