// `segsim bench render`, `segsim bench curves` and `segsim table 2`.
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/process/measurement_record.h"
#include "core/progress.h"
#include "core/version.h"
#include "experiments/benchmarks/bench_curves.h"
#include "experiments/benchmarks/render_record.h"
#include "experiments/benchmarks/render_report.h"
#include "experiments/commands/commands.h"
#include "experiments/support/record_file.h"
#include "perception/data/image_file.h"
#include "renderer/scene/simd_target.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags {
  benchmarks::BenchSceneOptions scene;
  std::vector<std::string> sizes{"1280x720", "640x480"}, top_k{"4"}, bounds{"accutile"};
  std::string top_k_rule = "heaviest", backend = "cpu";
  std::vector<std::string> channels{"rgb", "depth", "normal", "labels"};
  std::vector<int> threads{0};
  int repeat = 5;
  fs::path json, csv, record;
};

/// A word of a list, or an error that names the list.
template <class Value>
Value value_of(const std::string& flag, const std::string& word,
               const std::map<std::string, Value>& values) {
  const auto found = values.find(word);
  if (found != values.end()) return found->second;
  std::string words;
  for (const auto& [name, value] : values) words += (words.empty() ? "" : " | ") + name;
  throw core::InputError::expected(flag, words, "\"" + word + "\"");
}

int number_of(const std::string& flag, const std::string& text, const std::string& wanted,
              int low, int high) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < low ||
      value > high) {
    throw core::InputError::expected(flag, wanted, "\"" + text + "\"");
  }
  return value;
}

void set_size(const std::string& text, benchmarks::BenchCase& setup) {
  const std::string wanted = "WxH, each 1 ... 16384";
  const std::size_t x = text.find('x');
  if (x == std::string::npos) {
    throw core::InputError::expected("--size", wanted, "\"" + text + "\"");
  }
  setup.width_px = number_of("--size", text.substr(0, x), wanted, 1, 16384);
  setup.height_px = number_of("--size", text.substr(x + 1), wanted, 1, 16384);
}

int top_k_of(const std::string& text) {
  if (text == "all") return renderer::kAllSurfels;
  return number_of("--top-k", text, "1 ... 24 or all", 1, renderer::kMaxTopK);
}

core::Channels channels_of(const std::vector<std::string>& words) {
  using core::Channels;
  const std::map<std::string, Channels> values{
      {"rgb", Channels::kRgb},          {"depth", Channels::kDepth},
      {"normal", Channels::kNormal},    {"labels", Channels::kLabels},
      {"all", Channels::kAll},          {"depth-normal", Channels::kDepthNormal},
      {"features", Channels::kFeatures}};
  Channels channels = Channels::kNone;
  for (const std::string& word : words) {
    channels = channels | value_of("--channels", word, values);
  }
  return channels;
}

/// Every combination of the flags, in the order in which they are printed.
std::vector<benchmarks::BenchCase> cases_of(const Flags& flags) {
  using renderer::TileBounds;
  using renderer::TopKRule;
  std::vector<benchmarks::BenchCase> cases;
  const renderer::Backend backend = renderer::backend_of(flags.backend);
  for (const std::string& size : flags.sizes) {
    for (const std::string& bounds : flags.bounds) {
      for (const std::string& top_k : flags.top_k) {
        for (const int threads : flags.threads) {
          benchmarks::BenchCase setup;
          set_size(size, setup);
          setup.channels = channels_of(flags.channels);
          setup.options.bounds = value_of<TileBounds>("--bounds", bounds,
                                                      {{"aabb", TileBounds::kAabb},
                                                       {"snugbox", TileBounds::kSnugBox},
                                                       {"accutile", TileBounds::kAccuTile},
                                                       {"paper", TileBounds::kPaper}});
          setup.options.top_k = top_k_of(top_k);
          setup.options.top_k_rule = value_of<TopKRule>(
              "--top-k-rule", flags.top_k_rule,
              {{"heaviest", TopKRule::kHeaviest}, {"first", TopKRule::kFirst}});
          setup.options.threads = threads;
          setup.backend = backend;
          cases.push_back(setup);
        }
      }
    }
  }
  return cases;
}

void save(const fs::path& file, const std::string& text) {
  if (file.empty()) return;
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

benchmarks::BenchScene load_scene(benchmarks::BenchSceneOptions options,
                                  core::Channels channels) {
  options.features = core::has(channels, core::Channels::kFeatures);
  benchmarks::BenchScene scene = benchmarks::load_bench_scene(options);
  if (options.features && !scene.surfels->has_features()) {
    throw core::InputError::expected("--channels features", "a scene with features",
                                     scene.name);
  }
  return scene;
}

void bench_render(const Flags& flags) {
  const std::vector<benchmarks::BenchCase> cases = cases_of(flags);
  const benchmarks::BenchScene scene = load_scene(flags.scene, cases.front().channels);
  const benchmarks::BenchProvenance provenance =
      benchmarks::bench_provenance(scene, cases, flags.repeat);
  std::vector<benchmarks::BenchResult> results;
  core::Progress progress(
      "bench",
      static_cast<std::int64_t>(cases.size() * scene.path.size()) * (flags.repeat + 1));
  std::int64_t before = 0;
  for (const benchmarks::BenchCase& setup :
       cases) {  // One renderer at a time: scenes may be large.
    int done = 0;
    results.push_back(
        benchmarks::run_cases(scene, {&setup, 1}, flags.repeat, [&](int frames, int) {
          done = frames;
          progress.update(before + done);
        }).front());
    before += done;
  }
  progress.finish();
  std::fputs(benchmarks::bench_text(provenance, results).c_str(), stdout);
  save(flags.json, benchmarks::bench_json(provenance, results));
  save(flags.csv, benchmarks::bench_csv(provenance, results));
  support::save_record(flags.record, benchmarks::bench_record(provenance, results));
}

void add_scene_flags(CLI::App& command, benchmarks::BenchSceneOptions& scene) {
  command.add_option("--scene", scene.scene, "room, a bundle folder or a surfel .ply")
      ->capture_default_str();
  command.add_option("--surfels", scene.surfels, "Of the room")
      ->check(CLI::Range(1, 100'000'000))
      ->capture_default_str();
  command.add_option("--spread", scene.spread, "Surfel scale of the room over its spacing")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  command.add_option("--rooms", scene.rooms, "Furnished rooms in all; only one is seen")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command.add_option("--seed", scene.seed, "Of the room, or of the walk through a bundle")
      ->capture_default_str();
  command.add_option("--views", scene.views, "Cameras on the path")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command.add_option("--hfov-deg", scene.hfov_deg, "Of bundles and files [degrees]")
      ->check(CLI::Range(10.0, 170.0))
      ->capture_default_str();
}

void add_render_bench(CLI::App& bench) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = bench.add_subcommand(
      "render", "Frame times, work counters and roofline on a camera path");
  add_scene_flags(*command, flags->scene);
  command->add_option("--size", flags->sizes, "Image sizes, WxH [px]")->capture_default_str();
  command->add_option("--top-k", flags->top_k, "Label votes per pixel: 1 ... 24, or all")
      ->capture_default_str();
  command->add_option("--top-k-rule", flags->top_k_rule, "heaviest | first")
      ->capture_default_str();
  command->add_option("--bounds", flags->bounds, "aabb | snugbox | accutile | paper")
      ->capture_default_str();
  command
      ->add_option("--channels", flags->channels,
                   "rgb | depth | normal | labels | all | depth-normal | features")
      ->capture_default_str();
  command->add_option("--threads", flags->threads, "0 = all processors")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command->add_option("--repeat", flags->repeat, "Measured passes over the path")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command->add_option("--json", flags->json, "Save results and provenance");
  command->add_option("--csv", flags->csv, "Save one line per case");
  command->add_option("--record", flags->record, support::kRecordHelp);
  command->callback([flags] { bench_render(*flags); });
}

struct CurveFlags {
  benchmarks::CurveOptions options;
  fs::path out;
};

void bench_curves(const CurveFlags& flags) {
  benchmarks::CurveOptions options = flags.options;
  core::Progress progress("curves", 1000);
  options.on_step = [&](const std::string& what, int done, int total) {
    progress.update(1000 * done / total, what);
  };
  const std::vector<benchmarks::Curve> curves = benchmarks::measure_curves(options);
  progress.finish();
  const std::string footer =
      "room, " + std::to_string(options.scene.surfels) + " surfels per room; " +
      std::to_string(benchmarks::thread_count(options.threads)) + " threads of " +
      core::processor_name() + ", " + renderer::simd_target() + "; segsim " + core::version();
  perception::write_image(flags.out, benchmarks::draw_curves(curves, footer));
  for (const benchmarks::Curve& curve : curves) {
    std::printf("%s: %s\n", curve.title.c_str(), curve.note.c_str());
    for (std::size_t i = 0; i < curve.x.size(); ++i) {
      std::printf("  %-8.4g %.4g\n", curve.x[i], curve.y[i]);
    }
  }
  std::printf("%s\n", flags.out.string().c_str());
}

void add_curves_bench(CLI::App& bench) {
  auto flags = std::make_shared<CurveFlags>();
  flags->options.scene.surfels = 300'000;
  flags->options.scene.views = 8;
  CLI::App* command = bench.add_subcommand(
      "curves", "Picture: time against pixels and hidden surfels, labels against K");
  command->add_option("--out", flags->out, "Picture, .png or .jpg")->required();
  benchmarks::BenchSceneOptions& scene = flags->options.scene;
  command->add_option("--surfels", scene.surfels, "Of one room")
      ->check(CLI::Range(1, 10'000'000))
      ->capture_default_str();
  command->add_option("--views", scene.views, "Cameras on the ring")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--repeat", flags->options.repeat, "Measured passes")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command->add_option("--threads", flags->options.threads, "0 = all processors")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->callback([flags] { bench_curves(*flags); });
}

struct AblationFlags {
  benchmarks::BenchSceneOptions scene;
  std::string size = "1296x968", format = "text", backend = "cpu";
  std::vector<std::string> channels{"rgb", "depth", "normal", "features"};
  fs::path output, record, truth;
  int threads = 0, repeat = 3, truth_views = 40;
};

void print_ablation(const AblationFlags& flags) {
  const support::TableFormat format = results::table_format_from(flags.format);
  benchmarks::BenchCase base;
  set_size(flags.size, base);
  base.options.threads = flags.threads;
  base.channels = channels_of(flags.channels);
  base.backend = renderer::backend_of(flags.backend);
  const std::vector<benchmarks::AblationRow> rows = benchmarks::ablation_rows(base);
  std::vector<benchmarks::BenchCase> cases;
  cases.reserve(rows.size());
  for (const benchmarks::AblationRow& row : rows) cases.push_back(row.setup);
  const benchmarks::BenchScene scene = load_scene(flags.scene, base.channels);
  std::optional<benchmarks::LabelledViews> truth;
  if (!flags.truth.empty()) {
    truth = benchmarks::load_labelled_views(flags.truth, flags.truth_views, scene.classes);
  }
  const benchmarks::BenchProvenance provenance =
      benchmarks::bench_provenance(scene, cases, flags.repeat);
  core::Progress progress(
      "table 2",
      static_cast<std::int64_t>(cases.size() * scene.path.size()) * (flags.repeat + 1));
  const std::vector<benchmarks::BenchResult> results = benchmarks::run_cases(
      scene, cases, flags.repeat, [&](int done, int) { progress.update(done); },
      truth ? &*truth : nullptr);
  progress.finish();
  if (!flags.output.empty()) {
    results::write_table_files(flags.output, "table2", [&](support::TableFormat form) {
      return benchmarks::ablation_table(provenance, rows, results, form);
    });
  }
  support::save_record(flags.record, benchmarks::ablation_record(rows, results));
  std::fputs(benchmarks::ablation_table(provenance, rows, results, format).c_str(), stdout);
}

}  // namespace

void add_bench_command(CLI::App& app) {
  CLI::App* command = light::add_listed(app, light::kCommands, "bench");
  command->require_subcommand(1);
  add_render_bench(*command);
  add_curves_bench(*command);
}

void add_ablation_table(CLI::App& table) {
  auto flags = std::make_shared<AblationFlags>();
  flags->scene.spread = 1.6;
  flags->scene.views = 8;
  CLI::App* command = light::add_listed(table, light::kTableCommands, "2");
  add_scene_flags(*command, flags->scene);
  command->add_option("--size", flags->size, "Image, WxH [px]")->capture_default_str();
  command
      ->add_option("--channels", flags->channels,
                   "Timed: rgb depth normal labels depth-normal features")
      ->capture_default_str();
  command->add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command->add_option("--truth", flags->truth,
                      "Recording with labels, of views that the scene was not trained on: PQ");
  command->add_option("--truth-views", flags->truth_views, "Of the recording, evenly spaced")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command->add_option("--threads", flags->threads, "0 = all processors")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->add_option("--repeat", flags->repeat, "Measured passes over the path")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->add_option("-o,--output", flags->output,
                      "Folder for table2.txt, .md, .tex, .csv and .json");
  command->add_option("--record", flags->record, support::kRecordHelp);
  command->callback([flags] { print_ablation(*flags); });
}

}  // namespace segsim::experiments::commands
