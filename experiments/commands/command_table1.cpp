// `segsim table 1`.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/commands.h"
#include "experiments/panoptic/panoptic_run.h"
#include "experiments/panoptic/panoptic_table.h"
#include "experiments/support/record_file.h"
#include "reconstruction/labels/panoptic_head.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags {
  std::string scenes, heads = "query", rules = "strict,zju", masks = "1", backend = "cpu";
  std::string format = "text";
  fs::path config, data, record, work = "out/table1";
  std::int64_t iterations = -1, label_iterations = -1;
  int shrink = 0;
  bool resume = false, quick = false;
  panoptic::PanopticRunOptions run;
};

/// "exact", or a level.
std::optional<double> mask_level(const std::string& text) {
  if (text == "exact") return std::nullopt;
  try {
    std::size_t used = 0;
    const double level = std::stod(text, &used);
    if (used == text.size() && level >= 0.0 && level <= 10.0) return level;
  } catch (const std::exception&) {  // Not a number: reported below.
  }
  throw core::InputError::expected("--masks", "exact, or a level of noise in [0, 10]",
                                   "\"" + text + "\"");
}

panoptic::PanopticRunOptions run_options(const Flags& flags, panoptic::PanopticScenes scenes) {
  panoptic::PanopticRunOptions options = flags.run;
  options.scenes = std::move(scenes.scenes);
  options.heads = panoptic::parse_heads(flags.heads);
  options.mask_level = mask_level(flags.masks);
  options.device.backend = renderer::backend_of(flags.backend);
  options.work = flags.work;
  if (!flags.config.empty())
    options.config = reconstruction::read_training_config(flags.config);
  if (flags.quick) panoptic::make_quick(options);
  if (flags.iterations >= 0) options.config.geometry.iterations = flags.iterations;
  if (flags.label_iterations >= 0) options.config.panoptic.iterations = flags.label_iterations;
  for (panoptic::PanopticScene& scene : options.scenes) {
    if (flags.shrink > 0) scene.shrink = flags.shrink;
  }
  return options;
}

/// Work of hours is not thrown away by a command that forgot --resume.
void check_work(const Flags& flags) {
  std::error_code error;
  if (flags.resume || !fs::exists(flags.work) || fs::is_empty(flags.work, error)) return;
  throw core::InputError::expected(flags.work.string(), "a new folder, or --resume",
                                   "files of an earlier run");
}

void write_table(const panoptic::PanopticTable& table, const fs::path& work) {
  results::write_table_files(work, "table1", [&](support::TableFormat format) {
    return panoptic::format_panoptic_table(table, format);
  });
}

void print_table1(const Flags& flags) {
  // All words are checked before anything runs.
  const support::TableFormat format = results::table_format_from(flags.format);
  panoptic::PanopticTable table;
  table.rules = panoptic::parse_rules(flags.rules);
  panoptic::PanopticScenes scenes = panoptic::panoptic_scenes(
      flags.quick && flags.scenes.empty() ? "flat-3" : flags.scenes, flags.data);
  table.missing = scenes.missing;
  table.quick = flags.quick;
  for (const panoptic::MissingScene& scene : table.missing) {
    std::fprintf(stderr, "not run: %s: %s\n", scene.title.c_str(), scene.why.c_str());
  }
  panoptic::PanopticRunOptions options = run_options(flags, std::move(scenes));
  check_work(flags);
  table.planned = static_cast<int>(options.scenes.size() * options.heads.size());
  options.on_result = [&](const std::vector<panoptic::SceneFigures>& results) {
    table.results = results;
    write_table(table, flags.work);  // What is there so far.
  };
  table.results = panoptic::run_panoptic_scenes(options);
  write_table(table, flags.work);
  support::save_record(
      flags.record,
      panoptic::panoptic_record(table, options.device.backend == renderer::Backend::kCuda));
  std::fputs(panoptic::format_panoptic_table(table, format).c_str(), stdout);
}

}  // namespace

void add_panoptic_table(CLI::App& table) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(table, light::kTableCommands, "1");
  command->add_option("--scenes", flags->scenes,
                      "flat-N, breakroom, house, folders of recordings, separated by commas; "
                      "or a YAML file; default: flat-3, flat-8 and what --data has");
  command
      ->add_option("--heads", flags->heads,
                   "Of " + reconstruction::panoptic_head_list(", ") +
                       ", separated by commas; heads of queries also with :joint, trained "
                       "together with the surfels")
      ->capture_default_str();
  command
      ->add_option("--rules", flags->rules,
                   "Of strict, trajectory, zju, lifting, coco (docs/metrics.md), or all")
      ->capture_default_str();
  command
      ->add_option("--masks", flags->masks,
                   "exact: learn from exact labels; else the level of simulated masks, fitted "
                   "to the published quality at 1 (docs/masks.md)")
      ->capture_default_str();
  command->add_option("--data", flags->data, "Folder of the data of breakroom and house");
  command->add_option("--work", flags->work, "Folder for everything that is made")
      ->capture_default_str();
  command->add_flag("--resume", flags->resume,
                    "Keep what is finished in the work folder and go on");
  command->add_option("--config", flags->config,
                      "Weights and rates (YAML), see reconstruction/training/defaults.yaml");
  command->add_option("--iterations", flags->iterations, "Of shape and colour")
      ->check(CLI::Range(0, 10'000'000));
  command->add_option("--label-iterations", flags->label_iterations, "Of each head")
      ->check(CLI::Range(1, 10'000'000));
  command->add_option("--shrink", flags->shrink, "n x n pixels become one, in all scenes")
      ->check(CLI::Range(1, 64));
  command->add_option("--held-out-every", flags->run.held_out_every, "Every n-th frame tests")
      ->check(CLI::Range(2, 1'000'000))
      ->capture_default_str();
  command->add_option("--backend", flags->backend, "cpu | cuda | auto: where training runs")
      ->capture_default_str();
  command->add_option("--threads", flags->run.device.threads, "Of the CPU; 0: all")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command->add_option("--seed", flags->run.seed, "Of all random choices")
      ->capture_default_str();
  command->add_flag("--quick", flags->quick,
                    "Tiny pictures and few iterations, to see that it runs: no result");
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->add_option("--record", flags->record, support::kRecordHelp);
  command->callback([flags] { print_table1(*flags); });
}

}  // namespace segsim::experiments::commands
