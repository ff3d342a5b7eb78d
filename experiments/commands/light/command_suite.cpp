// `segsim suite list`, `show` and `verify`.
#include <cstdio>
#include <map>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/file_io.h"
#include "experiments/commands/light/light_commands.h"
#include "experiments/results/stored_run.h"
#include "experiments/suites/manifest.h"
#include "experiments/suites/suite.h"
#include "experiments/support/grid_document.h"
#include "experiments/support/listed.h"

namespace segsim::experiments::commands::light {
namespace {

namespace fs = std::filesystem;
using support::internal::Grid;

void print_grids(const std::vector<Grid>& grids, const std::vector<std::string>& notes) {
  std::fputs(support::internal::document_text({"", grids, notes}, support::TableFormat::kText)
                 .c_str(),
             stdout);
}

void list() {
  Grid grid{"Suites", {"Name", "Scenes", "Episodes", "Needs --data", "What"}, {}};
  for (const fs::path& file : suites::shipped_suites()) {
    const suites::Suite suite = suites::load_suite(file.string());
    std::int64_t episodes = 0;
    for (const suites::SuiteScene& scene : suite.scenes) episodes += scene.episodes;
    grid.rows.push_back({suite.name, std::to_string(suite.scenes.size()),
                         std::to_string(episodes), suite.data.empty() ? "no" : "yes",
                         suite.title});
  }
  print_grids({grid}, {"segsim suite show NAME tells more of one."});
}

struct ShowFlags {
  std::string suite;
  bool spec = false;
};

void show(const ShowFlags& flags) {
  const suites::Suite suite = suites::load_suite(flags.suite);
  if (flags.spec) {
    std::fputs(suite.spec_text.c_str(), stdout);
    return;
  }
  Grid grid{suite.title, {"Scene", "Title", "Pool", "Source", "Episodes"}, {}};
  for (const suites::SuiteScene& scene : suite.scenes) {
    grid.rows.push_back({scene.name, scene.title, scene.pool, scene.source,
                         scene.episodes > 0 ? std::to_string(scene.episodes) : "of a file"});
  }
  std::vector<std::string> notes{suite.about, "Arms: " + support::listed(suite.arms) + "."};
  if (!suite.data.empty()) notes.push_back("--data: " + suite.data);
  notes.push_back("SHA-256 of the suite: " + suite.sha256());
  print_grids({grid}, notes);
}

struct VerifyFlags {
  fs::path a, b;
};

/// Of a work folder what its results say; of a file what it says.
suites::Manifest manifest_in(const fs::path& place) {
  if (place.extension() == ".json") return suites::read_manifest(place);
  return suites::manifest_of(results::load_run(place));
}

std::string sentence(const suites::Manifest& manifest) {
  std::map<std::string, int> counts;
  for (const auto& [what, sha256] : manifest.hashes) {
    ++counts[what.substr(0, what.find(' '))];
  }
  return std::to_string(manifest.hashes.size()) + " hashes of " + manifest.suite +
         " are the same: the suite, " + std::to_string(counts["scene"]) + " scenes, " +
         std::to_string(counts["episodes"]) + " sets of episodes, " +
         std::to_string(counts["weights"]) + " files of weights" +
         (counts["results"] > 0 ? ", and the results" : "; the results are not all there yet");
}

void verify(const VerifyFlags& flags) {
  const suites::Manifest a = manifest_in(flags.a);
  if (!flags.b.empty()) {
    suites::expect_same(a, flags.a.string(), manifest_in(flags.b), flags.b.string());
    std::printf("%s.\n", sentence(a).c_str());
    return;
  }
  // Alone: the suite of that name here, and what the folder says of itself.
  const suites::Suite suite = suites::load_suite(a.suite);
  suites::Manifest wanted = a;
  for (auto& [what, sha256] : wanted.hashes) {
    if (what == "suite") sha256 = suite.sha256();
  }
  suites::expect_same(wanted, suite.file.string(), a, flags.a.string());
  const fs::path kept = flags.a / "suite" / "manifest.json";
  if (fs::is_directory(flags.a) && fs::exists(kept)) {
    suites::expect_same(a, "the results", suites::read_manifest(kept), kept.string());
  }
  std::printf("%s: the suite is that of %s (SHA-256 %s).\n", flags.a.c_str(),
              suite.file.c_str(), suite.sha256().c_str());
}

}  // namespace

CLI::App& add_suite_group(CLI::App& app) {
  CLI::App* suite = add_listed(app, kCommands, "suite");
  suite->require_subcommand(1);
  return *suite;
}

void add_suite_list(CLI::App& suite) {
  add_listed(suite, kSuiteCommands, "list")->callback([] { list(); });
}

void add_suite_show(CLI::App& suite) {
  auto flags = std::make_shared<ShowFlags>();
  CLI::App* command = add_listed(suite, kSuiteCommands, "show");
  command->add_option("suite", flags->suite, "Name of a suite, or its file (YAML)")
      ->required();
  command->add_flag("--spec", flags->spec, "Print the spec that `segsim run` would take");
  command->callback([flags] { show(*flags); });
}

void add_suite_verify(CLI::App& suite) {
  auto flags = std::make_shared<VerifyFlags>();
  CLI::App* command = add_listed(suite, kSuiteCommands, "verify");
  command->add_option("a", flags->a, "Work folder, or a manifest (.json)")->required();
  command->add_option(
      "b", flags->b, "Another one; without it A is compared with the suite of that name here");
  command->callback([flags] { verify(*flags); });
}

}  // namespace segsim::experiments::commands::light
